"""The daemon: serves one cell to clients, with one gate.

Packages, each with one concern:

- ``core``: one cell without sockets and clocks: commands to the gate, leases and their end,
  stops, signals, states, and the translation of gate outputs into messages.
- ``pace``: passing of time: wall clock, lock-step, or robots that are their own clock.
- ``sessions``: connections of clients: accepted, read in fair turns, written within bounds.
- ``auth``: tokens, roles, TLS and the Unix socket.
- ``recording``: the flight recorder.
- ``metrics``: health figures for Prometheus, and ``armgate status``.
- ``lifecycle``: start, signals, failures and end; ``armgate serve`` and ``armgate check``.

The path of a command from the socket to the link: ``sessions.reading``, ``core.core``, ``core.gate_runner``,
the gate, the link. Its verdict returns through ``core.gate_runner``, ``core.core``, ``core.to_protocol``,
``sessions.session`` and ``sessions.writing``. docs/architecture.md lists all files.
"""
