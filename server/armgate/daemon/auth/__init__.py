"""Login: tokens, roles, TLS, the Unix socket, and the bounds on the log of failed logins."""
