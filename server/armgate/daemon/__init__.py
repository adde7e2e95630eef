"""The daemon: sockets, sessions, leases and ticks around one gate.

``server`` (listens, lives and ends), ``session`` (one client), ``outbox`` (what waits for a slow one),
``core`` (every message and every tick), ``runner`` (the one place that asks the gate), ``wall``, ``lockstep``
and ``barrier`` (what makes time pass), ``leasing``, ``signals``, ``board`` (the newest states), ``library``
(the description), ``translate`` (gate to wire), ``log``, ``commands`` (``armgate serve``, ``armgate check``).
"""
