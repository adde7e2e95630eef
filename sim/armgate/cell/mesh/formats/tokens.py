"""Lines and numbers of mesh files in text form."""

import math
import re
from collections.abc import Iterable, Sequence

from armgate.cell.errors import ModelError

_MARK = b"\xef\xbb\xbf"
"""Byte order mark that some editors write at the beginning of a UTF-8 file."""

_COMMENT = re.compile(rb"(?<!1\.)#|#(?!QNAN|SNAN|IND|INF)")


def lines_of(data: bytes) -> list[bytes]:
    """Split a file at LF, CR LF or CR.

    Raises:
        ModelError: The file contains NUL bytes: it is binary, or has two or four bytes for a character.
    """
    if b"\0" in data:
        raise ModelError(
            f"byte {data.index(0)} is NUL; expected a text file in ASCII, Latin-1 or UTF-8: export it again"
        )
    return data.removeprefix(_MARK).splitlines()


def without_comment(line: bytes) -> bytes:
    """Return a line up to its comment; the ``#`` in "1.#QNAN" and "1.#INF" does not begin one."""
    return _COMMENT.split(line, maxsplit=1)[0]


def shown(token: bytes) -> str:
    """Return a piece of a file for an error message, shortened to 40 characters."""
    text = token.decode("latin-1")
    return repr(text if len(text) <= 40 else text[:37] + "...")


def numbers(tokens: Sequence[bytes], line: int) -> list[float]:
    """Read finite numbers.

    Raises:
        ModelError: A token is not a finite number; the text gives the line.
    """
    try:
        values = list(map(float, tokens))
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)) or any(b"_" in token for token in tokens):
        bad = next(token for token in tokens if not _is_finite(token))
        raise ModelError(f"line {line}: {shown(bad)} is not a finite number; expected a number, such as 0.25")
    return values


def is_number(token: bytes) -> bool:
    """Return True for a number, finite or not; NaN may also be spelled "-nan(ind)" or "1.#QNAN"."""
    try:
        float(token)
    except ValueError:
        return b"nan" in token.lower() or b".#" in token
    return True


def _is_finite(token: bytes) -> bool:
    try:
        return math.isfinite(float(token)) and b"_" not in token
    except ValueError:
        return False


def whole(token: bytes, line: int) -> int:
    """Read a whole number.

    Raises:
        ModelError: The token is not a whole number; the text gives the line.
    """
    digits = token[1:] if token[:1] in (b"-", b"+") else token
    if not digits.isdigit() or len(digits) > 18:
        raise ModelError(f"line {line}: {shown(token)} is not a whole number; expected one, such as 12")
    return int(token)


def wholes(tokens: Iterable[bytes], line: int) -> list[int]:
    """Read whole numbers, see ``whole``."""
    return [whole(token, line) for token in tokens]
