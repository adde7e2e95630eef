"""``armgate lead``: drive one robot along a recorded path, by hand, or towards another robot."""
