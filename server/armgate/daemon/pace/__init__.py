"""Passing of time: the wall clock, lock-step, or the clocks of the robots."""
