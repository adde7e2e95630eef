"""Command line of armgate, and the clients that it starts, such as lead, follow and view."""
