"""World: one cell in one process, without sockets, clocks and threads.

``world.World`` steps a cell under virtual time, with clients in the same process; docs/world.md shows its
use. The daemon serves the same parts over sockets:

- ``core``: processes requests of clients and ticks of robots; ``gate_runner`` is the only caller of the gate.
- ``lockstep``, ``barrier``: virtual time, which passes when all participants are done.
- ``lease_changes``, ``stopping``, ``signals``, ``states``, ``motion``: leases, stops, signals, states, rest.
- ``description``, ``assets``, ``welcome``, ``session_list``, ``to_protocol``: contents of messages.
- ``rights``: requests that each role may send.
- ``client``, ``mailbox``: clients of a world; ``saving``: saved worlds; ``run_recorders``: recordings.
"""

from armgate.world.client import SessionEndedError, WorldClient
from armgate.world.run_recorders import RunRecorder
from armgate.world.saving import SavedWorldError
from armgate.world.world import World

__all__ = ["RunRecorder", "SavedWorldError", "SessionEndedError", "World", "WorldClient"]
