"""Tokens: the clients that are accepted, and their roles.

A token is 256 random bits, of which the file holds only the SHA-256. A slow hash such as scrypt protects
secrets that people choose and that can be guessed. One of 2^256 equally likely values cannot be guessed, even
if each guess is cheap. A slow hash in the daemon would also let every client that connects delay the ticks.

The file has one JSON object per line. To revoke a token, delete its line. Only its owner may write the file.
"""

import hashlib
import hmac
import math
import os
import secrets
import stat
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from time import time
from typing import Annotated, Self

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, ValidationError, model_validator

from armgate.protocol.messages import Hash, Name, Role

PREFIX = "armgate_"
"""Prefix of every secret, by which scanners for leaked secrets identify it."""

_BYTES = 32
"""Random bytes of a secret."""

_LONGEST = 1 << 24
"""Largest number of characters of a token file."""

RANKS: dict[Role, int] = {"observer": 0, "controller": 1, "operator": 2}
"""Ranks of roles: each role includes the rights of those below it."""


class TokenError(Exception):
    """Invalid token file; the text names file and line."""

    exit_code = 2


class Token(BaseModel):
    """One line of the file: a client that is accepted, by a secret or by its certificate.

    Attributes:
        name: Name of its owner, for the log.
        role: Highest role that it allows; its owner may connect in a lower one.
        robots: Robots that its owner may command; None: all.
        sha256: Hash of the secret, in hex.
        certificate: SHA-256 of the client's certificate in DER, in hex; shown over TLS instead of a secret.
        expires: Time at which it expires; None: never.
    """

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")
    name: Name
    role: Role
    robots: Annotated[tuple[Name, ...], Field(min_length=1)] | None = None
    sha256: Hash | None = None
    certificate: Hash | None = None
    expires: AwareDatetime | None = None

    @model_validator(mode="after")
    def _one_proof(self) -> Self:
        if (self.sha256 is None) == (self.certificate is None):
            raise ValueError("expected either sha256 or certificate")
        return self

    def allows(self, role: Role) -> bool:
        """Return True if its owner may connect in this role."""
        return RANKS[role] <= RANKS[self.role]

    def expired(self, now: float) -> bool:
        """Return True if it has expired at this Unix time, s."""
        return self.expires is not None and self.expires.timestamp() <= now

    @property
    def grant(self) -> "Token":
        """The token without its expiry; if it changes when tokens are reloaded, the session ends."""
        return self.model_copy(update={"expires": None})


@dataclass(frozen=True)
class Made:
    """A new token and its secret, which is stored nowhere."""

    token: Token
    secret: str


class Tokens:
    """All tokens of a daemon."""

    def __init__(self, tokens: Sequence[Token]) -> None:
        self._tokens = tuple(tokens)

    def __iter__(self) -> Iterator[Token]:
        return iter(self._tokens)

    def of_certificate(self, certificate: bytes) -> Token | None:
        """Return the token that is bound to this certificate, in DER."""
        given = hashlib.sha256(certificate).hexdigest()
        return next((token for token in self._tokens if token.certificate == given), None)

    def find(self, secret: str | None) -> Token | None:
        """Return the token with this secret; the time that this takes reveals nothing about the secrets."""
        given = digest(secret or "")
        found = None
        for token in self._tokens:
            if hmac.compare_digest(given, token.sha256 or ""):
                found = token
        return found


def digest(secret: str) -> str:
    """Return the hash by which a secret is stored."""
    return hashlib.sha256(secret.encode()).hexdigest()


def make(name: str, role: Role, robots: Sequence[str] | None, expires: datetime | None = None) -> Made:
    """Return a new token.

    Raises:
        ValueError: The name, or that of a robot, is invalid.
    """
    secret = PREFIX + secrets.token_urlsafe(_BYTES)
    own = None if robots is None else tuple(robots)
    return Made(Token(name=name, role=role, robots=own, sha256=digest(secret), expires=expires), secret)


def read(file: Path) -> Tokens:
    """Return all tokens in a file.

    Raises:
        TokenError: It cannot be read, other users may write it, or a line is not a token.
    """
    if file.exists() and not file.is_file():
        raise TokenError(f"{file}: not a regular file; expected tokens created by `armgate token`")
    try:
        with file.open(encoding="utf-8") as opened:
            text, found = opened.read(_LONGEST + 1), os.fstat(opened.fileno())
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8"
        raise TokenError(f"{file}: {reason}; expected tokens created by `armgate token`") from error
    if len(text) > _LONGEST:
        raise TokenError(
            f"{file}: more than {_LONGEST} characters; expected tokens created by `armgate token`"
        )
    if found.st_uid not in (os.geteuid(), 0):
        owner = f"belongs to user {found.st_uid}, who could add tokens"
        raise TokenError(f"{file}: {owner}; expected a file of this user or of root")
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise TokenError(f"{file}: other users may write it, and so add tokens; run: chmod 600 {file}")
    lines = enumerate(text.splitlines(), start=1)
    tokens = [_token(file, number, line) for number, line in lines if line.strip()]
    _once(file, tokens)
    return Tokens(tokens)


def append(file: Path, token: Token) -> None:
    """Add a token to a file; create the file if it does not exist.

    Raises:
        TokenError: The file is invalid, or holds a token of that name.
        OSError: It cannot be written.
    """
    _write(file, [*(read(file) if file.exists() else ()), token])


def rotate(file: Path, name: str, until: datetime | None) -> Made:
    """Give the owner of a token a new secret; return it.

    Args:
        file: The token file.
        name: Name of the token.
        until: Time until which the old secret stays valid, unless it expires before; None: it ends now.

    Raises:
        TokenError: The file cannot be read, or holds no secret of that name that is still valid.
        OSError: It cannot be written.
    """
    known = [*read(file)]
    old = [token for token in known if token.name == name and token.sha256 is not None]
    if not old:
        raise TokenError(f"{file}: no secret of {name}; expected one of {', '.join(t.name for t in known)}")
    last = max(old, key=_end)
    if last.expired(time()):
        raise TokenError(f"{file}: {name} has expired; delete its line and create a new token")
    made = make(name, last.role, last.robots, last.expires)
    rest = [token for token in known if token.name != name]
    kept = [] if until is None else [last.model_copy(update={"expires": _earlier(until, last.expires)})]
    _write(file, [*rest, *kept, made.token])
    return made


def _end(token: Token) -> float:
    """Return the Unix time at which a token expires, s."""
    return math.inf if token.expires is None else token.expires.timestamp()


def _earlier(until: datetime, expires: datetime | None) -> datetime:
    return until if expires is None else min(until, expires)


def _write(file: Path, tokens: Sequence[Token]) -> None:
    """Replace the file as a whole, so that the daemon never reads half of it; a symbolic link to it stays."""
    file = file.resolve()
    _once(file, tokens)
    lines = "".join(token.model_dump_json(exclude_none=True) + "\n" for token in tokens)
    owner = file.stat() if file.exists() else None
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as out:
            out.write(lines)
            if owner is not None:
                os.fchmod(out.fileno(), stat.S_IMODE(owner.st_mode))
                if owner.st_uid != os.geteuid():
                    os.fchown(out.fileno(), owner.st_uid, owner.st_gid)
        Path(name).replace(file)
    except BaseException:
        Path(name).unlink()
        raise


def _token(file: Path, number: int, line: str) -> Token:
    try:
        return Token.model_validate_json(line)
    except ValidationError as error:
        problem = error.errors(include_url=False, include_input=False)[0]
        # An unknown key is not repeated in the text: it may be a secret in the wrong place.
        where = ".".join(str(key) for key in problem["loc"] if key in Token.model_fields)
        text = f"{file}:{number}: {where + ': ' if where else ''}{problem['msg']}"
        raise TokenError(f"{text}; expected a line created by `armgate token`") from None


def _once(file: Path, tokens: Sequence[Token]) -> None:
    """Check that names and hashes are unique.

    After a rotation, the old secret has the same name as the new one until it expires.
    """
    named: dict[str, list[Token]] = {}
    proven: dict[tuple[str | None, str | None], list[Token]] = {}
    for token in tokens:
        named.setdefault(token.name, []).append(token)
        proven.setdefault((token.sha256, token.certificate), []).append(token)
    if twice := sorted(name for name, same in named.items() if len(same) > 1 and not _rotated(same)):
        raise TokenError(f"{file}: two tokens named {', '.join(twice)}; give every token its own name")
    for same in proven.values():
        if len(same) > 1:
            text = f"{file}: the same secret or certificate for {' and '.join(token.name for token in same)}"
            raise TokenError(f"{text}; create a token for each")


def _rotated(same: Sequence[Token]) -> bool:
    """Return True if tokens of one name are an old and a new secret with the same rights."""
    allowed = {(token.role, frozenset(token.robots or ()), token.robots is None) for token in same}
    secrets_only = all(token.sha256 is not None for token in same)
    expiring = any(token.expires is not None for token in same)
    return len(same) == 2 and len(allowed) == 1 and secrets_only and expiring
