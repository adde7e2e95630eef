"""Errors of the monitor; the command line prints each as one line.

Tree::

    MonitorError            the monitor failed (exit status 1)
    └── DescriptionError    it cannot read its input, or write its output (exit status 2)
"""


class MonitorError(Exception):
    """The monitor failed; the text gives the reason and what to do."""

    exit_code = 1


class DescriptionError(MonitorError):
    """The monitor cannot read a configuration, URDF or mesh, or write its summary; the text names it."""

    exit_code = 2
