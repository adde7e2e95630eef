"""What the bits of a computation may depend on: versions of software, and the kind of machine."""

import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

_PACKAGES = ("armgate", "numpy", "pin", "coal", "python-fcl", "numba")


def software() -> dict[str, str]:
    """Versions of Python and of the packages that take part in a decision."""
    found = {"python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, str]:
    """The kind of machine: libraries choose their code by the processor."""
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
