"""Fuzzer of the protocol's decoder.

``python -m tools.fuzz [RUNS]``: atheris searches guided by code coverage; if it is not installed, hypothesis
mutates the vectors blindly. The exit status is 0 if no input broke the decoder; otherwise that input is
reported.
"""

import importlib
import importlib.util
import sys
import tempfile
from pathlib import Path

_MEMORY_MB = 512
_LONGEST = 1024


def main(arguments: list[str]) -> int:
    """Return the exit status; atheris ends the process itself."""
    if len(arguments) > 1 or not all(argument.isdecimal() for argument in arguments):
        print(__doc__, file=sys.stderr)
        return 2
    runs = int(arguments[0]) if arguments else 100_000
    if importlib.util.find_spec("atheris") is not None:
        return _guided(runs)
    print("fuzz: atheris is not installed; hypothesis searches blindly")
    return _blind(runs)


def _guided(runs: int) -> int:
    atheris = importlib.import_module("atheris")
    with atheris.instrument_imports(include=["armgate.protocol"]):
        from tools.fuzz.corpus import corpus  # noqa: PLC0415 (instrumented)
        from tools.fuzz.target import check  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        for number, data in enumerate(corpus()):
            Path(folder, f"vector-{number:04}").write_bytes(data)
        options = [f"-runs={runs}", f"-max_len={_LONGEST}", f"-rss_limit_mb={_MEMORY_MB}", "-timeout=10"]
        atheris.Setup([sys.argv[0], *options, "-print_final_stats=1", folder], check)
        atheris.Fuzz()
    return 0


def _blind(runs: int) -> int:
    from tools.fuzz.blind import search  # noqa: PLC0415

    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # reset the peak of the memory
    before = _memory_kb("VmRSS")
    broken = search(runs)
    if broken is not None:
        print(f"fuzz: {broken}", file=sys.stderr)
        return 1
    grown = (_memory_kb("VmHWM") - before) // 1024
    print(f"fuzz: {runs} runs, nothing found, at most {grown} MB more than at the start")
    return 0 if grown < _MEMORY_MB else 1


def _memory_kb(what: str) -> int:
    """Return the memory of this process, kB: VmRSS is the current value, VmHWM the peak."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(status.split(f"{what}:")[1].split()[0])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
