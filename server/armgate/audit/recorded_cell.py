"""Cell of a recording, built from the files in it, unchanged or with changed values."""

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

_WITHOUT_EFFECT = ("armgate", "name", "clock", "server", "recording", "metrics")
"""Sections of the configuration that do not affect verdicts."""


def recorded_cell(header: Header) -> Cell:
    """Return the recorded cell.

    Raises:
        AuditError: Its files do not form a cell, or this armgate builds another cell from them.
    """
    try:
        cell = _build(header, None)
    except (CellError, OSError) as error:
        raise AuditError(f"the recording's configuration: {_without_path(str(error))}") from error
    if cell.hash != header.hash:
        text = (
            f"this armgate builds another cell from its files ({cell.hash[:12]}…, not {header.hash[:12]}…); "
            f"use the armgate that wrote it ({header.software.get('armgate', '?')})"
        )
        raise AuditError(text)
    return cell


def changed_cell(header: Header, settings: Sequence[str]) -> Cell:
    """Return the cell with changed configuration values.

    Args:
        header: Header of the recording.
        settings: Each ``key.path=value``; the value is YAML.

    Raises:
        UseError: A setting is malformed or not allowed by the configuration; the text names what is expected.
    """
    overlay: dict[str, Any] = {}
    for setting in settings:
        _put(overlay, setting)
    try:
        return _build(header, yaml.safe_dump(overlay))
    except ConfigError as error:
        raise UseError(f"--set {error.path or ' '.join(settings)}: {_without_path(str(error))}") from error


def _build(header: Header, overlay: str | None) -> Cell:
    files = {name: header.file(name) for name in header.files}
    with tempfile.TemporaryDirectory(prefix="armgate-") as folder:
        return build_cell(load_packed(files, Path(folder), overlay))


def _put(overlay: dict[str, Any], setting: str) -> None:
    path, equals, text = setting.partition("=")
    keys = path.strip().split(".")
    if not equals or not all(keys):
        raise UseError(f"--set {setting}: expected KEY.PATH=VALUE, such as stop_distance=0.08")
    if keys[0] in _WITHOUT_EFFECT:
        raise UseError(f"--set {setting}: no verdict depends on {keys[0]}; set another key")
    try:
        value = yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise UseError(f"--set {setting}: {text!r} is not a value: {error}") from error
    for key in keys[:-1]:
        overlay = overlay.setdefault(key, {})
        if not isinstance(overlay, dict):
            raise UseError(f"--set {setting}: {key} has a value from an earlier --set; give only one of them")
    overlay[keys[-1]] = value


def _without_path(text: str) -> str:
    """Return the first line without the name and line of the temporary file."""
    first = text.splitlines()[0]
    return first.partition(": ")[2] if first.startswith(tempfile.gettempdir()) else first
