"""``armgate sessions``: lists the sessions of a daemon, and ends one of them."""
