"""``armgate lead``: drives one robot along a recorded path."""
