"""What a daemon keeps of its work and tells of its health; none of it changes what the gate decides."""

from typing import Annotated

from pydantic import Field

from armgate.cell.values import Part


class RecordingConfig(Part):
    """What the daemon records.

    Attributes:
        folder: Where: each start makes a folder of its own in it, named by the time; None: nothing is
            recorded, unless ``armgate serve --record`` says where.
        required: Whether the robots shall rest when something could not be recorded.
        rotate: After so many bytes the next file begins.
        queue: How many records may wait for the disk; what comes then is lost, and said so.
        sign: File of a private key (Ed25519, PEM) that signs each file when it is closed; None: no signature.
    """

    folder: str | None = None
    required: bool = False
    sign: str | None = None
    rotate: Annotated[int, Field(ge=1 << 20)] = 1 << 28
    queue: Annotated[int, Field(ge=256, le=1 << 20)] = 16384


class MetricsConfig(Part):
    """Where figures for Prometheus are served, on 127.0.0.1 only; None: nowhere, 0: any free port."""

    port: Annotated[int, Field(ge=0, le=65535)] | None = None
