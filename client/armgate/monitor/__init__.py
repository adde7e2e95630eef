"""Independent monitor of a cell, which shares no code with the gate, the cell model and the distance engines.

It has its own readers of the configuration, the URDFs and the meshes, and its own kinematics and distances.
It checks every state: live, as a client that stops the cell, or offline, from a recording. See
docs/monitor.md.

``monitor`` is pure: states in, findings out. ``live``, ``offline`` and ``command`` are thin shells around it.
"""
