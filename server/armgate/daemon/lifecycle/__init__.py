"""Start and end of a daemon: `armgate serve`, `armgate check`, signals, failures."""
