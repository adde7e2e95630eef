"""Brings a frame of a robot to a target, through the daemon, and uses the joints that are over."""
