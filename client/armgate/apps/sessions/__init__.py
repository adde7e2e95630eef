"""``armgate sessions``: list the sessions of a daemon, or end one."""
