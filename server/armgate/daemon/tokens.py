"""Tokens: who may come in, and as what.

A token is 256 random bits; its file holds only the SHA-256. A slow hash (scrypt) protects secrets that people
choose, which can be guessed; 2^256 equally likely ones cannot, however cheap a guess is, and a slow hash in
the daemon would let anybody who connects hold up the ticks.

The file is one JSON object a line: who deletes a line takes that token back. Only its owner may write it.
"""

import hashlib
import hmac
import os
import secrets
import stat
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from armgate.protocol.messages import Hash, Name, Role

PREFIX = "armgate_"
"""Tells those who scan for lost secrets what they have found."""

_BYTES = 32
RANKS: dict[Role, int] = {"observer": 0, "controller": 1, "operator": 2}
"""Roles in order: each may do what those below it may."""


class TokenError(Exception):
    """A file of tokens is not what it should be; the text names file and line."""

    exit_code = 2


class Token(BaseModel):
    """What is kept of one token.

    Attributes:
        name: Whose it is, for the log.
        role: The most that it allows; its owner may come in as less.
        robots: The robots that it lets command, None: all.
        sha256: Hash of the secret, in hex.
    """

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")
    name: Name
    role: Role
    robots: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    sha256: Hash

    def allows(self, role: Role) -> bool:
        """Whether its owner may come in as this."""
        return RANKS[role] <= RANKS[self.role]


@dataclass(frozen=True)
class Made:
    """A new token, and its secret, which is kept nowhere."""

    token: Token
    secret: str


class Tokens:
    """All tokens of a daemon."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        self._tokens = tuple(tokens)

    def __iter__(self) -> Iterator[Token]:
        return iter(self._tokens)

    def find(self, secret: str | None) -> Token | None:
        """The token with this secret; how long this takes does not tell which, or how near it was."""
        given = digest(secret or "")
        found = None
        for token in self._tokens:
            if hmac.compare_digest(given, token.sha256):
                found = token
        return found


def digest(secret: str) -> str:
    """What is kept of a secret."""
    return hashlib.sha256(secret.encode()).hexdigest()


def make(name: str, role: Role, robots: Sequence[str] | None) -> Made:
    """A new token.

    Raises:
        ValueError: One of the names cannot be a name.
    """
    secret = PREFIX + secrets.token_urlsafe(_BYTES)
    own = None if robots is None else tuple(robots)
    return Made(Token(name=name, role=role, robots=own, sha256=digest(secret)), secret)


def read(file: Path) -> Tokens:
    """All tokens in a file.

    Raises:
        TokenError: It cannot be read, others may write it, or a line is no token.
    """
    try:
        with file.open(encoding="utf-8") as opened:
            text, found = opened.read(), os.fstat(opened.fileno())
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8"
        raise TokenError(f"{file}: {reason}; expected tokens made by `armgate token`") from error
    if found.st_uid not in (os.geteuid(), 0):
        owner = f"belongs to user {found.st_uid}, who could let anybody in"
        raise TokenError(f"{file}: {owner}; expected a file of this user or of root")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise TokenError(f"{file}: others may write it, and so let themselves in; run: chmod 600 {file}")
    lines = enumerate(text.splitlines(), start=1)
    tokens = [_token(file, number, line) for number, line in lines if line.strip()]
    _once(file, tokens)
    return Tokens(tokens)


def append(file: Path, token: Token) -> None:
    """Write one more token to a file, which is made if there is none.

    Raises:
        TokenError: The file holds something else, or a token of that name.
        OSError: It cannot be written.
    """
    known = [*read(file)] if file.exists() else []
    _once(file, [*known, token])
    with os.fdopen(os.open(file, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600), "ab") as out:
        out.write(_missing_end(file) + token.model_dump_json().encode() + b"\n")


def _missing_end(file: Path) -> bytes:
    data = file.read_bytes()
    return b"\n" if data and not data.endswith(b"\n") else b""


def _token(file: Path, number: int, line: str) -> Token:
    try:
        return Token.model_validate_json(line)
    except ValidationError as error:
        problem = error.errors(include_url=False, include_input=False)[0]
        # What stands where no key of ours stands is not repeated: it may be a secret in the wrong place.
        where = ".".join(str(key) for key in problem["loc"] if key in Token.model_fields)
        text = f"{file}:{number}: {where + ': ' if where else ''}{problem['msg']}"
        raise TokenError(f"{text}; expected a line made by `armgate token`") from None


def _once(file: Path, tokens: Sequence[Token]) -> None:
    names = [token.name for token in tokens]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise TokenError(f"{file}: two tokens named {', '.join(twice)}; give every token a name of its own")
