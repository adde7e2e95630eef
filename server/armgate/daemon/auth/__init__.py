"""Login: tokens, roles, TLS, the Unix socket, and the bounds on what failed logins may log."""
