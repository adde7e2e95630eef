"""``armgate follow``: keeps one robot's camera on another robot's tool."""
