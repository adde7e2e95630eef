"""Supervision of a run: check of each telegram, and the reactions of the link.

While the link synchronises, telegrams have to agree with the configuration first, and then the probe has to
prove mode, axes and scales. From then on a robot at rest has to be where it was commanded to be, and must not
move on beyond its setpoints.
"""

from armgate.events import Joints
from armgate.links.plan_player import PlanPlayer
from armgate.links.rsi.diagnostics import Diagnostics
from armgate.links.rsi.ipoc_and_delay import Succession
from armgate.links.rsi.program_run import UNKNOWN, Run
from armgate.links.rsi.setpoint import SetpointTracker
from armgate.links.rsi.setup import Setup
from armgate.links.rsi.states import Event, LinkStates, State
from armgate.links.rsi.synchronisation import Agreement
from armgate.links.rsi.telegram import Telegram

_SETTLED = 1.0
"""Time after which a resting robot has reached its commanded position, s."""
_ADDS = (
    "moves on beyond its setpoints, as if the KRC added corrections up (RSI_ON with #RELATIVE): it is "
    "answered with zeros; start its program anew"
)
_DEVIATION_HINT = (
    "check the limits of AXISCORR, the tags in RECEIVE, and that RSI_ON has the mode of the cell"
)


class Supervisor:
    """Supervisor of the runs of one link.

    Args:
        setup: Robot and KRC.
        states: State of the link.
        player: The robot's plan.
        diagnostics: Notes to the operator.
    """

    def __init__(
        self, setup: Setup, states: LinkStates, player: PlanPlayer, diagnostics: Diagnostics
    ) -> None:
        self._setup = setup
        self._states = states
        self._player = player
        self._diagnostics = diagnostics
        self._agreement = Agreement(setup)

    def synchronise(self, run: Run | None) -> None:
        """Begin to gather evidence; a mode that this run has proven stays proven."""
        self._agreement.begin()
        if run is not None:
            run.agreed = False
            run.probe.begin()

    def check_start(self, run: Run) -> None:
        """Check that the robot is at the reference of a new run; if not, the run is never answered."""
        misplaced = self._agreement.misplaced(run.commanded.reference, run.q)
        if misplaced is not None:
            self.block(run, misplaced, silent=True)

    def check(self, run: Run, telegram: Telegram, succession: Succession, paused: bool, now: float) -> None:
        """Check the next telegram of a run."""
        disturbed = bool(succession.late or succession.missed)
        # Until it is proven, an absolute KRC holds one of two corrections of the probe. Both are smaller than
        # the tolerance, so its position counts as known.
        known = run.commanded.settle(succession, paused) or not (run.proven or self._setup.relative)
        if disturbed or paused:
            self.hold(run, max(succession.late, succession.missed))
        else:
            run.late_in_a_row = 0
        run.accepted |= succession.late == 0
        if not known:
            self.block_unknown(run)
        objection = (
            run.objection
            or run.jumped(telegram.q, succession.missed + 1)
            or (run.too_late() if disturbed else None)
        )
        if objection is not None:
            self._states.fault(objection)
        self._check_agreement(run, telegram, succession, now)
        if run.proven and not self._setup.relative and not run.adds:
            self._check_accumulation(run, telegram, succession.missed + 1)

    def hold(self, run: Run, cycles: int) -> None:
        """Drop the plan: the KRC has held the robot, which starts again from rest, and does not catch up."""
        run.late_in_a_row += cycles
        run.rebased = True
        self._player.drop()
        self._states.go(Event.HELD)

    def block(self, run: Run, reason: str, *, silent: bool = False) -> None:
        """Block all further motion in this run.

        Args:
            run: The run.
            reason: Reason, for the operator.
            silent: True if no reply is known to hold the robot: then the KRC is not answered.
        """
        run.objection, run.silent = reason, run.silent or silent
        if self._states.armed:
            self._states.fault(reason)
        else:
            self._diagnostics.note(reason)

    def block_unknown(self, run: Run) -> None:
        """Block all further motion in this run: the position that the KRC holds is unknown.

        Zeros hold a relative KRC in any case; an absolute one is not answered.
        """
        self.block(run, UNKNOWN, silent=not self._setup.relative)

    # --- parts of a check ---------------------------------------------------------------------------------

    def _check_agreement(self, run: Run, telegram: Telegram, succession: Succession, now: float) -> None:
        if self._states.state is State.SYNCHRONISING:
            verdict = self._evidence(run, telegram, succession, now)
            if verdict == "":
                run.counter.learning = False
                run.proven = True
                run.resting_since = now
                self._states.ready()
            elif verdict is not None and run.agreed:
                self.block(run, verdict)
            elif verdict is not None:
                self._states.fault(verdict)
        elif self._states.state is State.READY and now - run.resting_since > _SETTLED:
            deviation = self._agreement.deviation(run.commanded.setpoint, telegram.q)
            if deviation is not None:
                # The KRC does not apply replies as intended: no further reply can be right.
                self.block(run, f"{deviation}: {_DEVIATION_HINT}")

    def _evidence(self, run: Run, telegram: Telegram, succession: Succession, now: float) -> str | None:
        """Return "" if telegrams agree and the probe proves the mode, else the objection; None: undecided."""
        clean = not (succession.late or succession.missed)
        verdict = None
        if not run.agreed:
            clean = not self._anchored(run, telegram.q) and clean
            verdict = self._agreement.take(run.commanded, telegram.q, clean, now)
            run.agreed = verdict == ""
        if run.agreed and not run.proven:
            verdict = run.probe.take(telegram.q, run.commanded.offset, succession, now)
        for hint in self._agreement.hints(telegram, verdict is not None):
            self._diagnostics.note_once(hint)
        return verdict

    def _anchored(self, run: Run, q: Joints) -> bool:
        """Take the measured position as the reference if the robot moves; return True if so.

        This applies only if corrections count from the measured position, and until the first one is sent.
        """
        if self._setup.programmed or run.proven or not run.probe.moved(run.commanded.reference, q):
            return False
        run.commanded = SetpointTracker(self._setup.axes, q, self._setup.relative)
        run.rebased = True
        return True

    def _check_accumulation(self, run: Run, telegram: Telegram, cycles: int) -> None:
        """Detect a robot that moves on although its correction is constant; zeros then stop it."""
        commanded = run.commanded
        number = run.accumulation.take(telegram.q, commanded.setpoint, commanded.reference, cycles)
        if number is not None:
            run.adds = run.rebased = True
            self._player.drop()
            self.block(run, f"{self._setup.axes[number].name} {_ADDS}")
