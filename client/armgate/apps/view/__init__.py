"""``armgate view``: a web page that shows a cell, and lets an operator stop, reset, zoom and drive."""
