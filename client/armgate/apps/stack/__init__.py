"""A whole stack on one machine: processes, what is observed of them, the folder and the figures of a run."""
