"""What a case comes to."""

from enum import Enum


class Outcome(Enum):
    """The verdict on one side of a case, from good to bad."""

    PASS = "PASS"  # noqa: S105 (a verdict)
    SKIPPED = "SKIPPED"
    NON_STRICT = "NON-STRICT"
    """A SHOULD was not kept; with ``--strict`` that is a failure."""
    FAIL = "FAIL"

    @property
    def badness(self) -> int:
        """Greater is worse."""
        return list(Outcome).index(self)


class Unmet(Exception):  # noqa: N818 (about the server, not of the kit)
    """The conversation did not go as the specification wants; the text says where."""


class Skip(Exception):  # noqa: N818
    """The case cannot be tried on this server; the text says why."""


def check(holds: bool, text: str) -> None:
    """Fail the session verdict of the running case unless something holds.

    Raises:
        Unmet: It does not.
    """
    if not holds:
        raise Unmet(text)
