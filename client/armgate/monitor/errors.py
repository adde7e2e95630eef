"""Errors of the monitor; the command line prints each as one line.

Tree::

    MonitorError            the monitor failed or found a violation (exit status 1)
    └── DescriptionError    it cannot read what it was given (exit status 2)
"""


class MonitorError(Exception):
    """The monitor could not do its work; the text says why and what to do."""

    exit_code = 1


class DescriptionError(MonitorError):
    """A configuration, URDF or mesh that the monitor cannot read; the text names the place."""

    exit_code = 2
