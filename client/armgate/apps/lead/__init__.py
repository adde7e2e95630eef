"""``armgate lead``: drives one robot along a recorded path, or by hand."""
