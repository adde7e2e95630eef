"""A second judge of a cell, which shares no code with the gate, the cell model and the distance engines.

It reads the configuration, the URDFs and the meshes by itself, computes kinematics and distances by itself,
and checks every state: live as a client that stops the cell, or later from a recording. See docs/monitor.md.

``core`` is pure: states in, findings out. ``live``, ``audit`` and ``command`` are thin shells around it.
"""
