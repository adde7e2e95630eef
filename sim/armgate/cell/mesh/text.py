"""Lines and numbers of mesh files in text form."""

import math
import re
from collections.abc import Iterable, Sequence

from armgate.cell.errors import ModelError

_MARK = b"\xef\xbb\xbf"
"""The byte order mark with which some editors begin a UTF-8 file."""

_COMMENT = re.compile(rb"(?<!1\.)#|#(?!QNAN|SNAN|IND|INF)")


def lines_of(data: bytes) -> list[bytes]:
    """Split a file at LF, CR LF or CR.

    Raises:
        ModelError: The file holds NUL bytes: it is binary, or a text of two or four bytes a character.
    """
    if b"\0" in data:
        raise ModelError(
            f"byte {data.index(0)} is NUL; expected a text file of one byte a character (ASCII, Latin-1 or "
            f"UTF-8): export it again"
        )
    return data.removeprefix(_MARK).splitlines()


def without_comment(line: bytes) -> bytes:
    """Return a line up to its comment; the sign in "1.#QNAN" and "1.#INF" begins none."""
    return _COMMENT.split(line, maxsplit=1)[0]


def shown(token: bytes) -> str:
    """Return a piece of a file for an error message, shortened."""
    text = token.decode("latin-1")
    return repr(text if len(text) <= 40 else text[:37] + "...")


def numbers(tokens: Sequence[bytes], line: int) -> list[float]:
    """Read finite numbers.

    Raises:
        ModelError: One token is something else; the text names the line.
    """
    try:
        values = list(map(float, tokens))
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)) or any(b"_" in token for token in tokens):
        bad = next(token for token in tokens if not _is_finite(token))
        raise ModelError(f"line {line}: {shown(bad)} is no finite number; expected a number, as 0.25")
    return values


def is_number(token: bytes) -> bool:
    """Return True for a number, finite or not, in any spelling: NaN is also "-nan(ind)" or "1.#QNAN"."""
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
        ModelError: The token is something else; the text names the line.
    """
    digits = token[1:] if token[:1] in (b"-", b"+") else token
    if not digits.isdigit() or len(digits) > 18:
        raise ModelError(f"line {line}: {shown(token)} is no whole number; expected one, as 12")
    return int(token)


def wholes(tokens: Iterable[bytes], line: int) -> list[int]:
    """Read whole numbers, see ``whole``."""
    return [whole(token, line) for token in tokens]
