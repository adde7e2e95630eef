"""Errors of the commands on recordings, other than those of the recording itself."""


class AuditError(Exception):
    """The command failed; the text gives the reason."""

    exit_code = 1


class UseError(AuditError):
    """The command was called incorrectly."""

    exit_code = 2
