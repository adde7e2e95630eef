"""Initial inputs: the vectors, each for every decoder that may receive it."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import armgate.protocol
from armgate.protocol.framing import frame

_VECTORS = Path(armgate.protocol.__file__).parent / "vectors"
_LONGEST = 4096
CLIENT, SERVER, FRESH_SERVER, READY_SERVER, WAITING_CLIENT, READY_CLIENT = (bytes([i]) for i in range(6))


def corpus() -> list[bytes]:
    """Return all inputs, each once, without the very long ones."""
    return sorted({data for data in _inputs() if len(data) <= _LONGEST}, key=lambda data: (len(data), data))


def _inputs() -> Iterator[bytes]:
    for name in ("messages", "readable", "invalid"):
        for vector in _load(name):
            payload = bytes.fromhex(vector["hex"])
            if vector["from"] == "client":
                readers = (FRESH_SERVER, READY_SERVER)
                yield CLIENT + payload
            else:
                readers = (WAITING_CLIENT, READY_CLIENT)
                yield SERVER + payload
            for reader in readers:
                yield reader + frame(payload)
    for vector in _load("streams"):
        yield READY_SERVER + b"".join(bytes.fromhex(p["hex"]) * p["times"] for p in vector["pieces"])


def _load(name: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((_VECTORS / f"{name}.json").read_text(encoding="utf-8"))
    return found
