"""Header of a recording: the cell with all its files, the software and the machine."""

import base64
import time
from collections.abc import Mapping

from armgate.cell.cell import Cell
from armgate.cell.compilation import available
from armgate.cell.config.packing import pack
from armgate.recording import Header, machine, software
from armgate.world.description import CellDescription


def header_of(cell: Cell, start: str, lockstep: bool, now: float, compiled: bool | None = None) -> Header:
    """Return the header of a recording.

    Args:
        cell: The cell.
        start: The daemon's start id.
        lockstep: True if time passes in lock-step.
        now: Daemon time, s.
        compiled: True if the gate's kernels are compiled; None: True if compiled kernels are available.
    """
    described = CellDescription(cell, lockstep)
    return Header(
        start=start,
        origin_ns=time.time_ns() - round(now * 1e9),
        cell=cell.name,
        hash=cell.hash,
        lockstep=lockstep,
        judge="compiled" if (available() if compiled is None else compiled) else "numpy",
        software=software(),
        machine=machine(),
        files=_texts(pack(cell.config)),
        description=described.description.model_dump(mode="json"),
        assets=_texts(described.assets.by_hash),
    )


def _texts(given: Mapping[str, bytes]) -> dict[str, str]:
    return {name: base64.b64encode(data).decode() for name, data in given.items()}
