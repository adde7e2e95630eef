"""The flight recorder of a daemon."""
