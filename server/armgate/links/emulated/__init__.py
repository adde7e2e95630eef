"""Emulated robots: the link, which emulates a robot in the process of the link, and the kind of link."""
