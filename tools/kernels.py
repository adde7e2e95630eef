"""Compilation of all kernels before the tests, so that no two test processes compile the same one.

``python -m tools.kernels`` compiles the kernels of the gate and of the camera law at the same time, in two
processes. They stay in numba's cache, so it takes only some seconds from the second time on.
"""

import subprocess
import sys

MODULES = ("armgate.gate", "armgate.control.compiled")

_PROGRAM = """
from armgate.cell.compilation import announced
from {} import prepare
with announced():
    prepare()
"""


def main() -> int:
    """Compile, and return 0 if both processes succeed."""
    programs = [_PROGRAM.format(module) for module in MODULES]
    running = [subprocess.Popen([sys.executable, "-c", program]) for program in programs]  # noqa: S603
    return max([abs(process.wait()) for process in running])


if __name__ == "__main__":
    sys.exit(main())
