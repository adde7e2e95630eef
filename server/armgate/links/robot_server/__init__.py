"""Robots behind a process of their own, the robot server, and the daemon's way to it.

``messages`` and ``codec`` (what goes over the socket), ``liveness`` (who has fallen silent), ``berth`` (a
link as one daemon after the other sees it), ``server`` (the process), ``socket`` (its address), ``client``
(the daemon's side), ``make`` (links from a configuration), ``command`` (``armgate robot-server``).
"""
