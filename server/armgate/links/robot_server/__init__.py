"""Robot server: a process that holds the links of a cell's robots, so that they outlive daemons.

``messages`` and ``codec`` define the messages on the socket, ``unix_socket`` its path and permissions,
``connection`` one end of it with heartbeat and timeout. ``server`` is the process, ``hosted_link`` a link
in it, ``client`` the daemon's side, ``command`` is ``armgate robot-server``.
"""
