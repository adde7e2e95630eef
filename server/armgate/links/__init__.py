"""Links: the connections to robots, one package for each kind.

``link`` is the interface of a link, ``plan_player`` the part that every link has, ``own_clock`` a clock
for the link of a robot that has none. ``emulated`` and ``rsi`` are kinds of link. ``robot_server`` holds the
links of real robots in a process of their own; ``log`` and ``systemd`` serve that process and the daemon.
"""
