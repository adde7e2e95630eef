"""What the commands on recordings raise beside what is wrong with the recording itself."""


class AuditError(Exception):
    """The command failed; the text says why."""

    exit_code = 1


class UseError(AuditError):
    """The command was called wrongly."""

    exit_code = 2
