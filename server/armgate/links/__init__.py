"""Links: the connections to robots, one package for each kind.

``link`` is the interface of a link, ``plan_player`` the part that every link has, ``wall_clocked`` a clock
for links that need one. ``emulated`` and ``rsi`` are kinds of link. ``robot_server`` holds the links of real
robots in a process of their own; ``log`` and ``systemd`` serve that process and the daemon.
"""
