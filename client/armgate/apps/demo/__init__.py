"""``armgate demo``: the whole stack on one machine, observed, measured and plotted."""
