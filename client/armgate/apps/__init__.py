"""Command line of armgate, and its programs, such as lead, follow and view: clients of the daemon."""
