"""Programs that are clients of the daemon like any other: the command line, lead, follow and demo."""
