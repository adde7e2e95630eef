"""Emulated robots: their link, which emulates the robot in its own process, and its kind."""
