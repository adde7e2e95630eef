"""The cell of a recording, built again from the files that it carries, be it with other values."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml

from armgate.audit.errors import AuditError, UseError
from armgate.cell.cell import Cell, build_cell
from armgate.cell.config.packing import load_packed
from armgate.cell.errors import CellError, ConfigError
from armgate.recording import Header

_FIXED = ("armgate", "name", "clock", "server", "recording", "metrics")
"""Values that no judgement depends on."""


def recorded_cell(header: Header) -> Cell:
    """The cell as it was.

    Raises:
        AuditError: Its files are no cell, or this armgate makes another cell of them than was recorded.
    """
    try:
        cell = _build(header, None)
    except (CellError, OSError) as error:
        raise AuditError(f"the recording's configuration: {_plain(str(error))}") from error
    if cell.hash != header.hash:
        text = (
            f"its configuration gives another cell here: {cell.hash[:12]}…, recorded {header.hash[:12]}…; "
            f"use the armgate that wrote it ({header.software.get('armgate', '?')})"
        )
        raise AuditError(text)
    return cell


def changed_cell(header: Header, settings: Sequence[str]) -> Cell:
    """The cell under other rules.

    Args:
        header: Of the recording.
        settings: Each ``key.path=value``; the value is YAML.

    Raises:
        UseError: A setting is none, or the configuration does not allow it; the text says what it expects.
    """
    overlay: dict[str, Any] = {}
    for setting in settings:
        _put(overlay, setting)
    try:
        return _build(header, yaml.safe_dump(overlay))
    except ConfigError as error:
        raise UseError(f"--set {error.path or ' '.join(settings)}: {_plain(str(error))}") from error


def _build(header: Header, overlay: str | None) -> Cell:
    files = {name: header.file(name) for name in header.files}
    with tempfile.TemporaryDirectory(prefix="armgate-") as folder:
        return build_cell(load_packed(files, Path(folder), overlay))


def _put(overlay: dict[str, Any], setting: str) -> None:
    path, equals, text = setting.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise UseError(f"--set {setting}: expected KEY.PATH=VALUE, such as stop_distance=0.08")
    if keys[0] in _FIXED:
        raise UseError(f"--set {setting}: no judgement depends on {keys[0]}; set something else")
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise UseError(f"--set {setting}: {text!r} is not a value: {error}") from error
    for key in keys[:-1]:
        overlay = overlay.setdefault(key, {})
        if not isinstance(overlay, dict):
            raise UseError(f"--set {setting}: {key} was set to a value before; set one of them")
    overlay[keys[-1]] = value


def _plain(text: str) -> str:
    """Without the temporary file's name and line."""
    first = text.splitlines()[0]
    return first.partition(": ")[2] if first.startswith(tempfile.gettempdir()) else first
