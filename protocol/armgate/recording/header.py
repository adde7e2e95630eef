"""Header and metadata records of a recording's files.

A file is MCAP with the profile ``armgate``. Its first metadata record states the format, its first message is
the header, and a closed file ends with two metadata records: ``END`` and ``SEAL``.
"""

import base64
import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

FORMAT = 1
"""Format number; raised when readers of the previous format would misread a file, not for additions."""

PROFILE = "armgate"
METADATA = "armgate"
"""Name of the metadata record that states the format at the start of a file."""

SEAL = "armgate.seal"
"""Name of the metadata record that ends the hash chain of a closed file."""

END = "armgate.end"
"""Name of the metadata record before the seal; it states whether another part follows."""

_LATEST_NS = 253_402_300_799 * 10**9
"""End of the year 9999, ns since 1970."""

_PACKAGES = ("armgate", "numpy", "pin", "coal", "python-fcl", "numba")


def _base64(files: dict[str, str]) -> dict[str, str]:
    for name, text in files.items():
        try:
            base64.b64decode(text, validate=True)
        except ValueError as error:
            raise ValueError(f"{name[:60]!r} is not in base64") from error
    return files


Packed = Annotated[dict[str, str], AfterValidator(_base64)]
"""File contents by name, in base64."""


class Header(BaseModel):
    """Header of a recording, repeated in every part.

    Attributes:
        format: Format of the recording, see ``FORMAT``.
        part: Number of this file, from 1.
        start: Start id of the daemon.
        previous: Seal of the previous part, in hexadecimal digits; empty in the first part.
        origin_ns: Time of day at daemon time 0, ns since 1970.
        cell: Name of the cell.
        hash: Hash of the cell, as in its description.
        lockstep: True if the daemon ran in lock-step.
        judge: Implementation of the gate's computations: ``numpy`` or ``compiled``.
        software: Versions by package, see :func:`software`.
        machine: Properties of the machine that can affect results, see :func:`machine`.
        files: Self-contained folder from which the cell can be built again: file names and contents
            (base64); ``config.yaml`` is the configuration.
        description: The cell's ``description`` message.
        assets: Assets by the hash that the description names (base64).
    """

    model_config = ConfigDict(frozen=True)

    format: int = FORMAT
    part: int = 1
    start: str
    previous: str = ""
    origin_ns: Annotated[int, Field(ge=0, le=_LATEST_NS)]
    cell: str
    hash: str
    lockstep: bool
    judge: str = "numpy"
    software: dict[str, str] = Field(default_factory=dict)
    machine: dict[str, str] = Field(default_factory=dict)
    files: Packed = Field(default_factory=dict)
    description: dict[str, Any] = Field(default_factory=dict)
    assets: Packed = Field(default_factory=dict)

    def file(self, name: str) -> bytes:
        """Return the content of one of the files.

        Raises:
            KeyError: There is no file with this name.
        """
        return base64.b64decode(self.files[name])

    def asset(self, hash_: str) -> bytes:
        """Return the asset with this SHA-256.

        Raises:
            KeyError: There is no asset with this hash.
            ValueError: The asset's content has another hash.
        """
        data = base64.b64decode(self.assets[hash_])
        if hashlib.sha256(data).hexdigest() != hash_:
            raise ValueError(f"the content of asset {hash_[:12]}… does not match its hash")
        return data


def header_record(header: Header) -> dict[str, str]:
    """Return the metadata record at the start of a file."""
    fields = {"format": header.format, "start": header.start, "part": header.part, "hash": header.hash}
    return {key: str(value) for key, value in fields.items()}


def end_record(last: bool) -> dict[str, str]:
    """Return the metadata record that states whether a file ends the recording or another part follows."""
    return {"last": "true" if last else "false"}


# --- results of the gate can depend on the software and on the kind of machine ----------------------------


def software() -> dict[str, str]:
    """Return the versions of Python and of the packages that take part in a decision."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, str]:
    """Return the kind of machine: numerical libraries select their code by processor."""
    libc = " ".join(platform.libc_ver())
    return {
        "system": platform.system(),
        "architecture": platform.machine(),
        "libc": libc,
        "processor": _processor(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
