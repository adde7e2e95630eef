"""What can be wrong with how a virtual KRC is set up.

KrcError: the KRC's file, its context or its robot cannot be used; nothing was sent.
"""


class KrcError(Exception):
    """The virtual KRC cannot start as it was set up; the text says where, why and what was expected."""

    exit_code = 2
