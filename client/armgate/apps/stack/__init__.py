"""Runs of the whole stack on one machine: its processes, observation, folder and figures."""
