"""World: one cell with its gate, emulated robots and clients in one process, stepped under virtual time.

It runs on the same core and the same lock-step as the daemon, without sockets, event loop and encoding. So a
client receives the same messages as from ``armgate serve --lockstep`` for the same requests, byte for byte
once they are encoded.
"""

from collections.abc import Sequence
from math import inf
from pathlib import Path

from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import LockstepClockConfig, in_lockstep, load_config
from armgate.gate import Gate
from armgate.links.kind import make_stepped_link
from armgate.protocol import DIALECTS, VERSIONS
from armgate.protocol import messages as m
from armgate.world import saving
from armgate.world.client import WorldClient
from armgate.world.core import Core
from armgate.world.description import CellDescription, lockstep_description
from armgate.world.gate_runner import GateRunner
from armgate.world.interfaces import Client, ClientRequest
from armgate.world.lease_changes import no_expiry
from armgate.world.lockstep import Lockstep
from armgate.world.mailbox import Mailbox
from armgate.world.no_log import NoLog
from armgate.world.run_recorders import RunRecorder, RunRecorders
from armgate.world.welcome import Greeter


class World:
    """One cell in one process.

    Participants command robots and share signals; other clients observe and stop. Time passes only in `step`.
    A world is not safe for use by several threads at once.

    Args:
        cell: The cell; no robot may have a clock of its own.
        participants: Names of the clients that take part; None: those of the cell's lock-step.
        recorders: Record the run.
        compiled: Form of the gate's kernels, as for `Gate`.

    Attributes:
        cell: The cell.

    Raises:
        ConfigError: A robot has a clock of its own.
        ValueError: No participants are given, and the clock of the cell is not lock-step.
    """

    def __init__(
        self,
        cell: Cell,
        participants: Sequence[str] | None = None,
        *,
        recorders: Sequence[RunRecorder] = (),
        compiled: bool | None = None,
    ) -> None:
        self.cell = cell
        start = cell.hash[:16]
        self._recorders = RunRecorders(recorders)
        self._links = [make_stepped_link(cell, robot, start) for robot in cell.robots]
        self._lockstep = _lockstep(cell, participants)
        self._core = self._make_core(Gate(cell, start, compiled))
        self._greeter = Greeter(cell.config, start, True, DIALECTS)
        self._mailboxes: list[Mailbox] = []
        self._clients: list[WorldClient] = []
        self._joined = 0
        self._recorders.begin(cell, start, self._lockstep.now, compiled)
        self._lockstep.start(self._core, self._tick)

    @classmethod
    def load(
        cls,
        *files: str | Path,
        participants: Sequence[str] | None = None,
        recorders: Sequence[RunRecorder] = (),
        compiled: bool | None = None,
    ) -> "World":
        """Return the world of a configuration, with later files as overlays.

        Args:
            files: Files of the configuration.
            participants: Names of the participants, instead of the configured clock.
            recorders: Record the run.
            compiled: Form of the gate's kernels, as for `Gate`.

        Raises:
            ConfigError: The configuration is not valid, or a robot has a clock of its own.
            ValueError: No participants are given, and the configured clock is not lock-step.
        """
        config = load_config([Path(file) for file in files])
        if participants is not None:
            config = in_lockstep(config, participants)
        return cls(build_cell(config), recorders=recorders, compiled=compiled)

    # --- time ---------------------------------------------------------------------------------------------

    @property
    def time(self) -> float:
        """Virtual time of the current step, s."""
        return self._lockstep.now()

    @property
    def number(self) -> int:
        """Number of the current step; the first is 0."""
        return self._lockstep.step

    @property
    def complete(self) -> bool:
        """True if all participants have joined and are done with the step; a daemon would end it now."""
        return self._lockstep.complete

    def step(self) -> int:
        """End the current step: decide the commands, let robots tick, send the states.

        Participants that are not done count as if they had passed. The step does not wait for participants
        that have not joined.

        Returns:
            The number of the new step.
        """
        self._lockstep.advance()
        self._forget_closed()
        return self.number

    # --- clients ------------------------------------------------------------------------------------------

    @property
    def clients(self) -> tuple[WorldClient, ...]:
        """Clients whose sessions have not ended, in the order in which they joined."""
        return tuple(client for client in self._clients if not client.ended)

    def client(self, name: str) -> WorldClient:
        """Return the client of this name that joined last and has not left, for example in a fork.

        Raises:
            KeyError: There is no such client.
        """
        for client in reversed(self.clients):
            if client.name == name:
                return client
        raise KeyError(f"no client {name}; there are {', '.join(one.name for one in self.clients) or 'none'}")

    def join(self, name: str, role: m.Role = "controller", capabilities: Sequence[str] = ()) -> WorldClient:
        """Add a client, as a daemon does after its hello.

        Args:
            name: Name of the client.
            role: Its role, which is granted.
            capabilities: Additions to the protocol that it supports.

        Raises:
            RemoteProtocolError: ``name_taken``: a participant of this name has joined and not left.
        """
        hello = m.Hello(versions=VERSIONS, name=name, role=role, capabilities=tuple(capabilities))
        self._joined += 1
        session = self._lockstep.session_id(name, self._joined)
        granted = Client(session, name, role, identity=session, capabilities=frozenset(hello.capabilities))
        mailbox = Mailbox(granted, self._lockstep.leave)
        self._lockstep.join(mailbox)
        welcome = self._greeter.welcome(granted, hello, VERSIONS[-1])
        client = WorldClient(mailbox, welcome, self._handle)
        self._mailboxes.append(mailbox)
        self._clients = [*self.clients, client]
        return client

    # --- copies -------------------------------------------------------------------------------------------

    def save(self) -> bytes:
        """Return the state of the world and of its clients, without cell and recorders.

        `restored` continues from it, also in another process. See `armgate.world.saving` for its limits.
        """
        return saving.save(self, self.cell, self._core.description)

    @classmethod
    def restored(cls, cell: Cell, state: bytes) -> "World":
        """Return a world with a saved state; it has no recorders.

        Args:
            cell: The cell of the saved world, or one that was built from the same configuration.
            state: Result of `save`. Restore only states that a trusted program has saved.

        Raises:
            SavedWorldError: The state is of another cell or version, or it is damaged.
        """
        return cls._copy(cell, state, lockstep_description(cell))

    def fork(self) -> "World":
        """Return a copy that shares only the cell, without recorders; `client` returns its clients.

        A copy that receives the same requests sends the same messages.
        """
        return self._copy(self.cell, self.save(), self._core.description)

    @classmethod
    def _copy(cls, cell: Cell, state: bytes, description: CellDescription) -> "World":
        world = saving.restore(state, cell, description)
        if not isinstance(world, cls):
            raise saving.SavedWorldError(f"not a saved world but a {type(world).__name__}")
        return world

    # --- inside -------------------------------------------------------------------------------------------

    def _make_core(self, gate: Gate) -> Core:
        links = {link.robot: link for link in self._links}
        core = Core(
            self.cell,
            GateRunner(gate, links, self._recorders.tap if self._recorders else None),
            self._links,
            self._lockstep.now,
            NoLog(),
            lockstep=True,
            lease_time=no_expiry,
            observers=[self._recorders.show] if self._recorders else (),
        )
        self._lockstep.attach(core)
        return core

    def _tick(self, time: float, robots: Sequence[int], step: int) -> None:
        self._core.tick([self._links[index].advance(time) for index in robots], step)

    def _handle(self, mailbox: Mailbox, request: ClientRequest) -> None:
        self._lockstep.handle(mailbox, request)
        if mailbox.closed:
            self._forget_closed()

    def _forget_closed(self) -> None:
        """End the sessions that were closed after an error."""
        closed = [mailbox for mailbox in self._mailboxes if mailbox.closed]
        if closed:
            self._mailboxes = [mailbox for mailbox in self._mailboxes if not mailbox.closed]
        for mailbox in closed:
            mailbox.leave()


def _lockstep(cell: Cell, participants: Sequence[str] | None) -> Lockstep:
    clock = cell.config.clock
    if participants is None:
        if not isinstance(clock, LockstepClockConfig):
            raise ValueError(f"no participants: the clock of {cell.name} is {clock.kind}; give their names")
        participants = clock.participants
    periods = [robot.period for robot in cell.robots]
    return Lockstep(periods, participants, inf, NoLog(), _no_wall_clock, automatic=False)


def _no_wall_clock() -> float:
    return 0.0
