"""Store of a campaign's results: a folder that survives kills, and that one process at a time writes.

Results are collected in parts. A part is complete or absent, so a process that is killed loses only the
results since the last part. The table at the end has all rows, sorted by key: it depends neither on the
order of the results nor on interruptions.
"""

import errno
import fcntl
import importlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from armgate.campaign.durable import TEMPORARY, write_durably
from armgate.campaign.errors import CampaignError, UsageError
from armgate.campaign.result import Result
from armgate.campaign.table import Row, from_parquet, result_of, row_of, to_parquet
from armgate.campaign.trials import Trial

PART_ROWS = 500
"""Largest number of rows of a part."""
PART_TIME = 2.0
"""Time after which a part is written, s."""
MANIFEST, TABLE, PARTS, LOCK = "campaign.json", "results.parquet", "parts", "lock"


class Store:
    """Store of one campaign, open for writing; a context manager that writes the last part.

    Args:
        folder: Folder of the store.
        manifest: Content of the campaign, as plain JSON; two runs of one store have the same.
        write: Writes bytes to a descriptor.
        clock: Time, s.

    Raises:
        UsageError: Another process has the store open, or it belongs to another campaign.
        CampaignError: The folder cannot be used.
        ModuleNotFoundError: The extra ``campaign`` is not installed.
    """

    def __init__(
        self,
        folder: Path,
        manifest: Mapping[str, Any],
        write: Callable[[int, bytes], int] = os.write,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.folder = folder
        self._write, self._clock = write, clock
        importlib.import_module("arro3.io")  # a missing extra is reported before the first trial
        self._new: dict[str, Row] = {}
        self._stored: dict[str, Row] = {}
        with self._full_disk():
            (folder / PARTS).mkdir(parents=True, exist_ok=True)
            self._lock = _locked(folder / LOCK)
            try:
                self._begin(manifest)
            except BaseException:
                os.close(self._lock)
                raise
        self._since = clock()

    @property
    def rows(self) -> dict[str, Row]:
        """Rows by key."""
        return self._stored | self._new

    def __contains__(self, key: str) -> bool:
        return key in self._stored or key in self._new

    def put(self, trial: Trial, result: Result) -> None:
        """Add a result; it is on the disk with the next part.

        Raises:
            CampaignError: A part cannot be written.
        """
        self._new[trial.key] = row_of(trial, result)
        if len(self._new) >= PART_ROWS or self._clock() - self._since >= PART_TIME:
            self.flush()

    def flush(self) -> None:
        """Write a part.

        Raises:
            CampaignError: It cannot be written; the results so far stay stored.
        """
        self._since = self._clock()
        if self._new:
            self._number += 1
            with self._full_disk():
                write_durably(
                    self.folder / PARTS / f"{self._number:06}.parquet",
                    to_parquet(self._new.values()),
                    self._write,
                )
            self._stored |= self._new
            self._new = {}

    def complete(self) -> Path:
        """Write the table of all results, and remove the parts.

        Raises:
            CampaignError: It cannot be written; all results stay stored.
        """
        self.flush()
        table = self.folder / TABLE
        with self._full_disk():
            write_durably(table, to_parquet(self._stored.values()), self._write)
        for part in self._parts():
            part.unlink()
        return table

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            with suppress(*([] if kind is None else [CampaignError])):  # the first error is the cause
                self.flush()
        finally:
            os.close(self._lock)

    def _begin(self, manifest: Mapping[str, Any]) -> None:
        for name in (MANIFEST, TABLE, f"{PARTS}/*.parquet"):
            for left in self.folder.glob(f"{name}{TEMPORARY}"):
                left.unlink()
        manifest_file = self.folder / MANIFEST
        if manifest_file.exists():
            check_manifest(manifest_file, manifest)
        elif (self.folder / TABLE).exists() or self._parts():
            raise UsageError(f"{self.folder}: holds results, but no {MANIFEST}; choose another --out")
        else:
            write_durably(manifest_file, json.dumps(manifest, indent=1, sort_keys=True).encode() + b"\n")
        self._stored = _read(self.folder)
        self._number = max((int(part.stem) for part in self._parts() if part.stem.isdecimal()), default=0)

    def _parts(self) -> list[Path]:
        return sorted((self.folder / PARTS).glob("*.parquet"))

    def _full_disk(self) -> "_DiskErrors":
        return _DiskErrors(self.folder, lambda: len(self._stored))


class _DiskErrors:
    """Context manager that turns errors of the disk into one error of the campaign."""

    def __init__(self, folder: Path, stored: Callable[[], int]) -> None:
        self._folder, self._stored = folder, stored

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, OSError):
            full = error.errno in (errno.ENOSPC, errno.EDQUOT)
            why = "the disk is full" if full else str(error.strerror)
            what = f"{self._folder}: cannot be written: {why}; {self._stored()} results are stored"
            if not full:
                raise CampaignError(f"{what}. Correct this, or choose another --out") from error
            raise CampaignError(f"{what}. Make space, and run the same command again to continue") from error


def read_results(folder: Path) -> dict[str, Result]:
    """Return the results of a store by key, without opening it for writing.

    Raises:
        CampaignError: A file of the store is damaged.
    """
    return {key: result_of(row) for key, row in _read(folder).items()}


def _read(folder: Path) -> dict[str, Row]:
    files = [
        *([folder / TABLE] if (folder / TABLE).exists() else []),
        *sorted((folder / PARTS).glob("*.parquet")),
    ]
    try:
        return {row["key"]: row for file in files for row in from_parquet(file)}
    except ValueError as error:
        raise CampaignError(f"{error}; remove the file, and its trials are run again") from error


def _locked(path: Path) -> int:
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        who = os.read(descriptor, 20).decode(errors="replace").strip() or "?"
        os.close(descriptor)
        raise UsageError(
            f"{path.parent}: the process {who} runs this campaign; wait for its end, or choose another --out"
        ) from error
    os.ftruncate(descriptor, 0)
    os.write(descriptor, f"{os.getpid()}\n".encode())
    return descriptor


def check_manifest(path: Path, manifest: Mapping[str, Any]) -> None:
    """Compare the content of a campaign with that of a store.

    Raises:
        UsageError: They differ; the text lists how.
        CampaignError: The file is damaged.
    """
    try:
        before = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise CampaignError(f"{path}: damaged: {error}; choose another --out") from error
    if changes := list(differences(before, json.loads(json.dumps(manifest)))):
        lines = [*changes[:10], *([f"… and {len(changes) - 10} more"] if len(changes) > 10 else [])]
        listed = "".join(f"\n  {line}" for line in lines)
        raise UsageError(
            f"{path.parent}: holds results of another campaign; choose another --out, or undo these changes:"
            f"{listed}"
        )


def differences(before: Any, now: Any, where: str = "") -> Iterator[str]:
    """Yield a line for each value that differs between two trees of plain JSON."""
    if isinstance(before, dict) and isinstance(now, dict):
        for key in sorted(before.keys() | now.keys()):
            yield from differences(before.get(key), now.get(key), f"{where}.{key}" if where else key)
    elif before != now:
        yield f"{where}: {_shown(before)} before, {_shown(now)} now"


def _shown(value: Any) -> str:
    text = "absent" if value is None else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 80 else text[:77] + "..."
