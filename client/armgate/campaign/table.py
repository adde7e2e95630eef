"""Table of results as Parquet: a row for each trial, written byte for byte equal from equal rows."""

import io
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from armgate.campaign.result import Result
from armgate.campaign.trials import Trial, canonical

VALUE, FIGURE = "value.", "figure."
"""Beginnings of the columns of drawn values and of figures."""
_FIXED = ("key", "scenario", "controllers", "seed", "outcome", "reason")
_MAGIC = b"PAR1"
"""Begin and end of a Parquet file."""
COMPLETED, FAILED = "completed", "failed"

Row = dict[str, Any]
"""Row by column; absent columns are null."""


def row_of(trial: Trial, result: Result) -> Row:
    """Return the row of a trial. Numbers become floats; drawn lists, truth values and nulls become JSON."""
    row: Row = {
        "key": trial.key,
        "scenario": trial.scenario,
        "controllers": trial.controllers,
        "seed": trial.seed,
        "outcome": FAILED if result.failed else COMPLETED,
        "reason": result.reason or None,
    }
    row |= {VALUE + key: _plain(value) for key, value in trial.values}
    return row | {FIGURE + name: value for name, value in result.figures.items()}


def result_of(row: Mapping[str, Any]) -> Result:
    """Return the result in a row."""
    figures = {
        name.removeprefix(FIGURE): value
        for name, value in row.items()
        if name.startswith(FIGURE) and value is not None
    }
    return Result(row["key"], row["reason"] or "", figures)


def to_parquet(rows: Iterable[Row]) -> bytes:
    """Return a Parquet file of the rows, sorted by key, with the columns in a fixed order."""
    from arro3.core import Array, DataType, Table
    from arro3.io import write_parquet

    ordered = sorted(rows, key=lambda row: str(row["key"]))
    kinds: dict[type, Callable[[], Any]] = {
        int: DataType.int64, float: DataType.float64, str: DataType.utf8,
    }  # fmt: skip
    columns: dict[str, Any] = {
        name: Array([_as(kind, row.get(name)) for row in ordered], type=kinds[kind]())
        for name in _columns(ordered)
        for kind in (_kind(name, ordered),)
    }
    stream = io.BytesIO()
    write_parquet(Table.from_pydict(columns), stream, compression="zstd(3)")
    return stream.getvalue()


def from_parquet(path: Path) -> list[Row]:
    """Return the rows of a file; null values are absent, except ``reason``.

    Raises:
        OSError: The file cannot be read.
        ValueError: It is not a table of results.
    """
    from arro3.io import read_parquet

    data = path.read_bytes()
    if len(data) < 2 * len(_MAGIC) or not (data.startswith(_MAGIC) and data.endswith(_MAGIC)):
        raise ValueError(f"{path}: not a table of results: not a complete Parquet file")
    try:
        table = read_parquet(io.BytesIO(data)).read_all()
        columns = {name: table.column(name).to_pylist() for name in table.column_names}
    except (KeyboardInterrupt, SystemExit, MemoryError):
        raise
    except BaseException as error:  # the library panics at a damaged file; its error is no Exception
        raise ValueError(f"{path}: not a table of results: {error}") from error
    if missing := [name for name in _FIXED if name not in columns]:
        raise ValueError(f"{path}: not a table of results: no column {missing[0]}")
    return [
        {name: column[at] for name, column in columns.items() if column[at] is not None or name == "reason"}
        for at in range(table.num_rows)
    ]


def _columns(rows: Sequence[Row]) -> list[str]:
    return [*_FIXED, *sorted({name for row in rows for name in row} - set(_FIXED))]


def _kind(name: str, rows: Sequence[Row]) -> type:
    """Return the type of a column: that of its values, text if they are mixed."""
    if name == "seed":
        return int
    if name in _FIXED:
        return str
    return str if any(isinstance(row.get(name), str) for row in rows) else float


def _as(kind: type, value: Any) -> Any:
    """Return a value for a column; a number in a column of texts becomes its text."""
    return repr(value) if kind is str and isinstance(value, float) else value


def _plain(value: Any) -> float | str:
    if isinstance(value, int | float) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, str):
        return value
    return canonical(value).decode().strip()
