"""``armgate follow``: keep one robot's camera on another robot's tool."""
