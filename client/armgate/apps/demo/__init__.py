"""``armgate demo``: the whole stack on one machine, watched, measured and drawn."""
