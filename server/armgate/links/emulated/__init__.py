"""Emulated robots: a link in the process that holds it, and its kind."""
