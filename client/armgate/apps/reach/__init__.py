"""``armgate reach``: move a robot's frame to a target, with redundancy resolution."""
