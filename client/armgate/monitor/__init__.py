"""Independent monitor of a cell, which shares no code with the gate, the cell model and the distance engines.

It has its own code for reading the configuration, URDFs and meshes, and for kinematics and distances.
It checks every state: live, as a client that stops the cell, or offline, from a recording. See
docs/monitor.md.

``monitor`` is pure: states in, findings out. ``live``, ``offline`` and ``command`` are thin shells around it.
"""
