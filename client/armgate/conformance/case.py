"""Test cases: their outcomes, their registration and their selection."""

import importlib
import pkgutil
import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING

from armgate.protocol.spec_statements import Level, Statement, When, statements

if TYPE_CHECKING:
    from armgate.conformance.context import CaseContext

Body = Callable[["CaseContext"], Awaitable[None]]
_ID = re.compile(r"([A-Z]+)-(\d+)(?:/[a-z0-9-]+)?")


# --- outcomes ---------------------------------------------------------------------------------------------


class Outcome(Enum):
    """Outcome of one side of a case, safety or session, from best to worst."""

    PASS = "PASS"  # noqa: S105 (an outcome, not a password)
    SKIPPED = "SKIPPED"
    NON_STRICT = "NON-STRICT"
    """A SHOULD was violated; with ``--strict`` that is a failure."""
    FAIL = "FAIL"

    @property
    def severity(self) -> int:
        """Rank of the outcome; a greater one is worse."""
        return list(Outcome).index(self)


class Violation(Exception):  # noqa: N818 (an error of the server, not of the kit)
    """The conversation deviated from the specification; the text names the place."""


class Skip(Exception):  # noqa: N818
    """The case cannot be run against this server; the text gives the reason."""


def check(condition: bool, text: str) -> None:
    """Fail the session outcome of the running case unless a condition is true.

    Raises:
        Violation: The condition is false.
    """
    if not condition:
        raise Violation(text)


# --- cases ------------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Case:
    """One test of a server.

    Attributes:
        id: Tested statement and a suffix, since several cases may test one statement.
        description: What the kit does.
        expectation: The behaviour of a server that satisfies the statement.
        body: Function that runs the case; raises ``Violation`` or ``Skip``.
        also: Further statements that it tests.
    """

    id: str
    description: str
    expectation: str
    body: Body
    also: tuple[str, ...] = ()

    @property
    def when(self) -> When:
        """Servers to which the case applies."""
        return self.statement.when

    @property
    def should(self) -> bool:
        """True if a failure breaks only a SHOULD."""
        return self.statement.level is not Level.MUST

    @property
    def statement(self) -> Statement:
        """Statement of the specification that the case tests."""
        return statements()[self.id.partition("/")[0]]

    @property
    def covers(self) -> tuple[str, ...]:
        """Ids of all statements that it tests."""
        return (self.id.partition("/")[0], *self.also)


_CASES: dict[str, Case] = {}


def case(
    id_: str,
    description: str,
    expectation: str,
    *,
    also: tuple[str, ...] = (),
) -> Callable[[Body], Body]:
    """Register a function as a case.

    The id is written out, not derived from the description or from the function's name: reports, ``--only``
    and tests refer to it. A function with parameters may run several cases: register a ``partial`` for each.
    """

    def register(body: Body) -> Body:
        if id_ in _CASES:
            raise ValueError(f"two cases have the id {id_}")
        _CASES[id_] = Case(id_, description, expectation, body, also)
        return body

    return register


@cache
def cases() -> tuple[Case, ...]:
    """Return all cases, in the order of the specification."""
    from armgate.conformance import cases as package  # noqa: PLC0415 (its modules import this one)

    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{module.name}")
    order = list(statements())
    return tuple(sorted(_CASES.values(), key=lambda c: (order.index(c.covers[0]), c.id)))


def select_cases(names: list[str]) -> tuple[Case, ...]:
    """Return the cases with these names: ids, statements, or the letters of statements.

    Raises:
        LookupError: A name matches no case.
    """
    if not names:
        return cases()
    unknown = [name for name in names if not any(_matches(each, name) for each in cases())]
    if unknown:
        raise LookupError(f"no case {', '.join(unknown)}; `armgate conformance --list` shows all")
    return tuple(each for each in cases() if any(_matches(each, name) for name in names))


def _matches(candidate: Case, name: str) -> bool:
    match = _ID.fullmatch(candidate.id)
    return match is not None and name in (candidate.id, candidate.id.partition("/")[0], match[1])
