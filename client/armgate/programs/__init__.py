"""Tick programs in a world: the controllers of `armgate.client.program`, without sockets.

::

    world = World.load("configs/demo.yaml", participants=["wave"])
    outcomes = run(world, {"wave": Controller(lambda context: Wave(), "FR")}, seconds=10.0)

A program sends the same messages, in the same order, as `armgate.client.program.run` sends to a daemon in
lock-step. Both use the session of the SDK, so leases, stops, refused signals and errors have the same effect.
"""

from armgate.programs.participant import Controller, Participant
from armgate.programs.runner import WorldRun, run
from armgate.programs.world_cell import WorldCell

__all__ = ["Controller", "Participant", "WorldCell", "WorldRun", "run"]
