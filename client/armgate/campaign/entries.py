"""Python entries of a campaign: import ``package.module:function``, and hash its file."""

import hashlib
import importlib
import inspect
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from armgate.campaign.errors import CampaignError


class EntryError(CampaignError):
    """Entry that cannot be imported on this machine."""

    exit_code = 2


def load_entry(entry: str, folder: Path) -> Callable[..., Any]:
    """Return the function of an entry; its module may be a file in ``folder``.

    Raises:
        EntryError: There is no such module or function, or its import fails.
    """
    name, _, attribute = entry.partition(":")
    try:
        _search_in(folder)
        module = importlib.import_module(name)
    except Exception as error:
        text = f"{entry}: cannot be imported ({type(error).__name__}: {error})"
        raise EntryError(f"{text}; expected a module that is installed or stands in {folder}") from error
    function = getattr(module, attribute, None)
    if not callable(function):
        raise EntryError(f"{entry}: {module.__name__} has no function {attribute}")
    found: Callable[..., Any] = function
    return found


def source_hash(entry: str, folder: Path) -> str:
    """Return SHA-256 of the file that defines an entry's function; "" if it has no file."""
    function = load_entry(entry, folder)
    try:
        file = inspect.getsourcefile(inspect.unwrap(function))
    except TypeError:
        return ""
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""


def _search_in(folder: Path) -> None:
    """Search modules in the folder, too, after all others; worker processes do the same."""
    place = str(folder.absolute())
    if place not in sys.path:
        sys.path.append(place)
