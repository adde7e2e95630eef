"""What is done with a recording: judge it again, explain it, report it, make it whole."""
