"""Health figures for Prometheus, and `armgate status`."""
