"""Errors of the monitor; the command line prints each as one line.

Tree::

    MonitorError            the monitor failed (exit status 1)
    └── DescriptionError    it cannot read its input (exit status 2)
"""


class MonitorError(Exception):
    """The monitor failed; the text gives the reason and what to do."""

    exit_code = 1


class DescriptionError(MonitorError):
    """The monitor cannot read a configuration, URDF or mesh; the text names the place."""

    exit_code = 2
