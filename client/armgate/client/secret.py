"""Secrets in files: tokens and keys that other users must not be able to read."""

import os
from pathlib import Path

from armgate.client.errors import BadArgument
from armgate.protocol.secret_file import SecretFileError, check_secret_file, read_secret_file

_LONGEST = 256


def read_token(file: str | os.PathLike[str]) -> str:
    """Return the token in a file, as ``armgate token --out`` writes it.

    Raises:
        BadArgument: It cannot be read, holds no token, belongs to another user, or others can read it.
    """
    path = Path(file)
    try:
        token = read_secret_file(path).strip()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "no text"
        raise BadArgument(f"{path}: {reason}; expected a token") from error
    except SecretFileError as error:
        raise BadArgument(str(error)) from error
    if not 0 < len(token) <= _LONGEST or len(token.split()) != 1:
        raise BadArgument(f"{path}: expected one token and nothing else, as `armgate token` prints it")
    return token


def check_key(file: str | os.PathLike[str]) -> None:
    """Check that a private key belongs to this user, and that others cannot read it.

    Raises:
        OSError: It cannot be read.
        BadArgument: It belongs to another user, or others can read it.
    """
    try:
        check_secret_file(Path(file))
    except SecretFileError as error:
        raise BadArgument(str(error)) from error
