"""Recorders of runs: events, outputs and states become the files of a recording.

- ``world_recorder``: recorder of a world, which needs no thread and no event loop.
- ``parts``, ``record_file``: files of a recording; ``header``: their header; ``signer``: key that signs them.

The daemon adds recorders with a queue, which delay no tick (`armgate.daemon.recording`).
"""

from armgate.recorder.world_recorder import WorldRecorder

__all__ = ["WorldRecorder"]
