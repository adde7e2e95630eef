"""Numbered statements of SPEC.md, parsed for the conformance kit and the tests."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from importlib.resources import files
from types import MappingProxyType

_ITEM = re.compile(r"^- \*\*(.*?)\*\*(.*(?:\n  .*)*)", re.MULTILINE)
_ID = re.compile(r"[A-Z]{3}-[1-9][0-9]*")
_REST = re.compile(r" \((\w+)(?:, ([a-z-]+))?\): (.+\.)")
_WORDS = re.compile(r"\b(MUST|SHOULD|MAY)\b")


class SpecError(Exception):
    """Malformed statement in the text of the specification."""


class Binds(StrEnum):
    """Party that a statement binds."""

    SERVER = "server"
    CLIENT = "client"
    BOTH = "both"
    HOST = "host"
    """Operator of the server's machine, in matters that are not visible on the wire."""
    TEXT = "text"
    """Later versions of the specification."""


class When(StrEnum):
    """Condition under which a statement applies."""

    ALWAYS = "always"
    CLOCK = "clock"
    """The server runs by the wall clock."""
    LOCKSTEP = "lock-step"
    TOKENS = "tokens"
    TLS = "tls"


class Level(StrEnum):
    """Level of a statement: the strongest of its keywords."""

    MUST = "MUST"
    SHOULD = "SHOULD"
    MAY = "MAY"


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement.

    Attributes:
        id: Stable id, such as ``LEA-7``.
        section: Title of its section.
        binds: Party that it binds.
        when: Condition under which it applies.
        level: MUST, SHOULD or MAY.
        text: The sentence.
    """

    id: str
    section: str
    binds: Binds
    when: When
    level: Level
    text: str

    @property
    def about_server(self) -> bool:
        """True if the statement binds a server in a way that a client can observe."""
        return self.binds in (Binds.SERVER, Binds.BOTH)


def spec_text() -> str:
    """Return the specification, in Markdown."""
    return files(__package__).joinpath("SPEC.md").read_text(encoding="utf-8")


@cache
def statements() -> Mapping[str, Statement]:
    """Return all statements by id, in the order of the text.

    Raises:
        SpecError: See :func:`parse`.
    """
    return MappingProxyType(parse(spec_text()))


def parse(text: str) -> dict[str, Statement]:
    """Return the statements in a text.

    Raises:
        SpecError: A statement lacks its id, the party that it binds, its sentence, or MUST, SHOULD or MAY, or
            an id occurs twice.
    """
    found: dict[str, Statement] = {}
    for section in re.split(r"^## ", text, flags=re.MULTILINE)[1:]:
        title = section.partition("\n")[0].strip()
        for item in _ITEM.finditer(section):
            statement = _statement(title, item[1], " ".join(item[2].split()))
            if statement.id in found:
                raise SpecError(f"{statement.id} occurs twice")
            found[statement.id] = statement
    return found


def _statement(section: str, id_: str, rest: str) -> Statement:
    if not _ID.fullmatch(id_):
        raise SpecError(f"{id_}: expected an id such as LEA-7")
    match = _REST.fullmatch(f" {rest}")
    if match is None:
        raise SpecError(f"{id_}: expected `(party, condition): sentence.`, got {rest[:40]}")
    words = set(_WORDS.findall(match[3]))
    level = next((level for level in Level if level.value in words), None)
    if level is None:
        raise SpecError(f"{id_}: expected a MUST, SHOULD or MAY in {match[3][:40]}")
    try:
        binds, when = Binds(match[1]), When(match[2] or When.ALWAYS)
    except ValueError as error:
        raise SpecError(f"{id_}: {error}") from error
    return Statement(id_, section, binds, when, level, match[3])
