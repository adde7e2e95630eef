"""Search with valid messages only: the daemon must keep the specification whatever clients send."""
