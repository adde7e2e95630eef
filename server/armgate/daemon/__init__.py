"""The daemon: serves one cell (`armgate.world`) to clients.

Packages, each with one concern:

- ``pace``: passing of time: wall clock, lock-step, or robots that are their own clock.
- ``sessions``: connections of clients: accepted, read in fair turns, written within bounds.
- ``auth``: tokens, roles, TLS and the Unix socket.
- ``recording``: the flight recorder.
- ``metrics``: health figures for Prometheus, and ``armgate status``.
- ``lifecycle``: start, signals, failures and end; ``armgate serve`` and ``armgate check``.

The path of a command from the socket to the link: ``sessions.reading``, ``world.core``,
``world.gate_runner``, the gate, the link. Its verdict returns through ``world.gate_runner``,
``world.core``, ``world.to_protocol``, ``sessions.session`` and ``sessions.writing``. docs/architecture.md
lists all files.
"""
