"""What a case is, and where all of them are found."""

import importlib
import pkgutil
import re
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

from armgate.protocol.statements import Level, Statement, When, statements

if TYPE_CHECKING:
    from armgate.conformance.trial import Trial

Body = Callable[["Trial"], Awaitable[None]]
_ID = re.compile(r"([A-Z]+)-(\d+)(?:/[a-z0-9-]+)?")


@dataclass(frozen=True, slots=True)
class Case:
    """One thing that is tried on a server.

    Attributes:
        id: The statement that it tries, and a word for how: several cases may try one.
        description: What the kit does.
        expectation: What a server that keeps the statement does.
        body: Does it; raises ``Unmet`` or ``Skip``.
        also: Further statements that it tries.
    """

    id: str
    description: str
    expectation: str
    body: Body
    also: tuple[str, ...] = ()

    @property
    def when(self) -> When:
        """On which servers it can be tried."""
        return self.statement.when

    @property
    def should(self) -> bool:
        """Whether only a SHOULD is broken if it fails."""
        return self.statement.level is not Level.MUST

    @property
    def statement(self) -> Statement:
        """What it tries, as the specification has it."""
        return statements()[self.id.partition("/")[0]]

    @property
    def covers(self) -> tuple[str, ...]:
        """Ids of all statements that it tries."""
        return (self.id.partition("/")[0], *self.also)


_CASES: dict[str, Case] = {}


def case(
    id_: str,
    description: str,
    expectation: str,
    *,
    also: tuple[str, ...] = (),
) -> Callable[[Body], Body]:
    """Register a function as a case."""

    def register(body: Body) -> Body:
        if id_ in _CASES:
            raise ValueError(f"two cases {id_}")
        _CASES[id_] = Case(id_, description, expectation, body, also)
        return body

    return register


@cache
def cases() -> tuple[Case, ...]:
    """All cases, in the order of the specification."""
    from armgate.conformance import cases as package  # noqa: PLC0415 (its modules import this one)

    for module in pkgutil.iter_modules(package.__path__):
        importlib.import_module(f"{package.__name__}.{module.name}")
    order = list(statements())
    return tuple(sorted(_CASES.values(), key=lambda c: (order.index(c.covers[0]), c.id)))


def selected(wanted: list[str]) -> tuple[Case, ...]:
    """The cases named: by id, by statement, or by a statement's letters.

    Raises:
        LookupError: A name fits none.
    """
    if not wanted:
        return cases()
    strange = [name for name in wanted if not any(_fits(one, name) for one in cases())]
    if strange:
        raise LookupError(f"no case {', '.join(strange)}; `armgate conformance --list` shows all")
    return tuple(one for one in cases() if any(_fits(one, name) for name in wanted))


def _fits(one: Case, name: str) -> bool:
    match = _ID.fullmatch(one.id)
    return match is not None and name in (one.id, one.id.partition("/")[0], match[1])
