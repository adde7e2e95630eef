"""Connections of clients: accepted, read in fair turns, written within bounds."""
