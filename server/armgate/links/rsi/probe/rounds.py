"""Rounds of the probe: the schedule of the corrections, and the sums of the measured offsets.

Every round begins and ends when the robot is measured to rest. If replies or telegrams are lost, the offset
that the KRC held depends on mode and HOLDON: a first round that is disturbed returns to its start and begins
again. Once the first round has proven the mode, the held offset is known, and is added to the sums instead.
"""

import math
from collections.abc import Sequence
from enum import StrEnum
from typing import TYPE_CHECKING

from armgate.events import Joints
from armgate.links.rsi.ipoc_and_delay import Succession
from armgate.links.rsi.probe.finding import Evaluation, Measurement, RoundSums
from armgate.links.rsi.probe.size import ProbeSize, probe_size

if TYPE_CHECKING:  # `setup` imports this package, to check the size of the probe
    from armgate.links.rsi.setup import Setup

_STILL = 8
"""Number of successive telegrams in which the position has to stay the same for a robot at rest."""
_TAIL, _REST = 0.001, 0.1
"""Largest motion within these telegrams at rest, and the same for continuous noise, in amplitudes."""
_NOISE = 0.02
"""Largest motion of a robot at rest for which a reference is kept, in tolerances."""
_NOISY = 128
"""Number of telegrams after which continuous motion counts as noise."""
_TIMEOUT = 30.0
"""Longest time of the probe, s."""
_MOVED = 0.8
"""Distance from the start of the first round above which a robot has not come back, in amplitudes."""
_BALANCED = 3
"""Base of the numeral system in which axes are numbered, with digits -1, 0 and 1."""


class Stage(StrEnum):
    """Stage of the probe.

    ``resting``: wait until the robot is measured to rest. ``wave``: send a round's corrections. ``back``: a
    telegram or reply was lost; return to where the round began. ``settling``: wait until the robot rests
    again. ``done``: nothing is left to send.
    """

    RESTING = "resting"
    WAVE = "wave"
    BACK = "back"
    SETTLING = "settling"
    DONE = "done"


class Step(StrEnum):
    """Event that ends a stage."""

    RESTED = "rested"
    DISTURBED = "disturbed"
    SENT = "sent"
    RETURNED = "returned"
    DECIDED = "decided"


TABLE: dict[tuple[Stage, Step], Stage] = {
    (Stage.RESTING, Step.RESTED): Stage.WAVE,
    (Stage.RESTING, Step.DECIDED): Stage.DONE,  # the robot has not come back after the last round
    (Stage.WAVE, Step.SENT): Stage.SETTLING,
    (Stage.WAVE, Step.DISTURBED): Stage.BACK,
    (Stage.BACK, Step.RETURNED): Stage.RESTING,
    (Stage.SETTLING, Step.RESTED): Stage.RESTING,
    (Stage.SETTLING, Step.DECIDED): Stage.DONE,
}


def digits_of(number: int, rounds: int) -> tuple[int, ...]:
    """Return a number in balanced ternary, the lowest digit first."""
    digits = []
    for _ in range(rounds):
        digit = (number + 1) % _BALANCED - 1
        digits.append(digit)
        number = (number - digit) // _BALANCED
    return tuple(digits)


class RestDetector:
    """Detection of a robot at rest, under noise.

    Args:
        size: Size of the probe.

    Attributes:
        noise: Motion of each axis at rest, rad or m.
    """

    def __init__(self, size: ProbeSize) -> None:
        self._size = size
        self.noise = [0.0] * len(size.amplitude)
        self.restart()

    def restart(self) -> None:
        """Forget the positions so far; the noise stays known."""
        self._still: list[Joints] = []
        self._waited = 0

    def rests(self, q: Joints, *, learn: bool) -> bool:
        """Take a position; return True if it has stayed the same, apart from the known noise.

        Args:
            q: Measured position.
            learn: True to add motion at rest to the known noise.
        """
        self._still = [*self._still[1 - _STILL :], q]
        self._waited += 1
        if len(self._still) < _STILL:
            return False
        spread = [max(column) - min(column) for column in zip(*self._still, strict=True)]
        noisy = self._waited > _NOISY
        steps = self._size.resolution if noisy else self.noise
        rows = zip(spread, self._size.amplitude, steps, strict=True)
        share = _REST if noisy else _TAIL
        if any(far > max(share * amplitude, 1.01 * step) for far, amplitude, step in rows):
            return False
        if learn:
            self.noise = [max(a, b) for a, b in zip(spread, self.noise, strict=True)]
        return True

    def mean(self) -> Joints:
        """Return the mean of the positions at rest."""
        return tuple(math.fsum(column) / len(column) for column in zip(*self._still, strict=True))


class Probe:
    """Probe of one run of the KRC's program.

    Args:
        setup: Robot and KRC.

    Attributes:
        stage: Stage of the probe.
        codes: Digits of each axis in the rounds after the first one.
    """

    def __init__(self, setup: "Setup") -> None:
        self._setup = setup
        self._size = probe_size(setup)
        count = len(setup.axes)
        rounds = next(n for n in range(1, 4) if _BALANCED**n // 2 >= count)
        self.codes = tuple(digits_of(number + 1, rounds) for number in range(count))
        self._signs = [(1,) * count, *zip(*self.codes, strict=True)]
        wave = [math.sin(math.pi * k / self._size.half) for k in range(2 * self._size.half)]
        added = [*(math.fsum(wave[: k + 1]) for k in range(len(wave) - 1)), 0.0]
        # Commanded offsets, in amplitudes. In the first round they give the same corrections in either mode.
        self._forms = [added if setup.relative else wave, *[added] * rounds]
        extent = math.fsum(map(abs, wave))
        self._evaluation = Evaluation(setup, self._size.amplitude, self.codes, math.fsum(added), extent)
        self.begin()

    def begin(self) -> None:
        """Begin with the first round."""
        self.stage = Stage.RESTING
        self._round = 0
        self._since: float | None = None
        self._sums: list[RoundSums] = []
        self._rest = RestDetector(self._size)
        self._home: Joints = ()
        self._missed = 0

    # --- a telegram ---------------------------------------------------------------------------------------

    def take(self, q: Joints, held: Joints, succession: Succession, now: float) -> str | None:
        """Take a telegram into account.

        Args:
            q: Measured position.
            held: Offset from the reference that the KRC has held since the last telegram.
            succession: Relation of the telegram to the last one.
            now: Time, s.

        Returns:
            "" if the KRC agrees with the cell, the objection if it does not, None while undecided.
        """
        self._since = now if self._since is None else self._since
        if self.stage is Stage.WAVE:
            self._follow(succession)
        if self.stage in (Stage.WAVE, Stage.SETTLING):
            self._add(q, held, succession.missed + 1)
        if self._rests(q):
            if self.stage is Stage.RESTING:
                return self._begin_round()
            return self._end_round()
        if now - self._since > _TIMEOUT:
            return (
                "the robot does not rest, or telegrams or replies are lost too often to prove the KRC's mode"
            )
        return None

    def moved(self, before: Joints, now: Joints) -> bool:
        """Return True if two positions differ by more than rounding and the noise of a robot at rest."""
        rows = zip(before, now, self._size.resolution, self._setup.tolerance, strict=True)
        return any(abs(a - b) > max(1.01 * step, _NOISE * far) for a, b, step, far in rows)

    def target(self, reference: Joints, setpoint: Joints, going: bool) -> Joints:
        """Return the next position to command.

        Args:
            reference: Position from which corrections count.
            setpoint: Commanded position now.
            going: True to go on with the round, False to return to the reference step by step.
        """
        if self.stage is Stage.WAVE and going:
            return self._next_of_wave(reference)
        near = self._nearer(reference, setpoint)
        if self.stage is Stage.BACK and near == reference:
            self._go(Step.RETURNED)
            self._rest.restart()
        return near

    # --- stages -------------------------------------------------------------------------------------------

    def _go(self, step: Step) -> None:
        self.stage = TABLE[self.stage, step]

    def _next_of_wave(self, reference: Joints) -> Joints:
        form = self._forms[self._round]
        place = form[self._sent] if self._sent < len(form) else 0.0
        self._sent += 1
        rows = zip(reference, self._signs[self._round], self._size.amplitude, strict=True)
        return tuple([origin + sign * far * place for origin, sign, far in rows])

    def _nearer(self, reference: Joints, setpoint: Joints) -> Joints:
        """Return a position on the way back, one step of the wave nearer to the reference."""
        step = math.sin(math.pi / self._size.half)
        rows = zip(reference, setpoint, self._size.amplitude, strict=True)
        return tuple(
            [
                origin if abs(origin - at) <= step * far else at + math.copysign(step * far, origin - at)
                for origin, at, far in rows
            ]
        )

    def _follow(self, succession: Succession) -> None:
        """Continue the wave, repeat a correction that was not taken, or begin anew."""
        disturbed = succession.late or succession.missed
        if disturbed and self._round == 0:
            self._go(Step.DISTURBED)
        elif succession.late > succession.missed:
            self._sent -= 1
        elif self._sent > len(self._forms[self._round]):
            self._go(Step.SENT)
            self._rest.restart()

    def _rests(self, q: Joints) -> bool:
        if self.stage not in (Stage.RESTING, Stage.SETTLING):
            return False
        return self._rest.rests(q, learn=self.stage is Stage.RESTING)

    def _begin_round(self) -> str | None:
        """Begin a round if the robot has returned to its position before the first round; else object."""
        self._origin = self._rest.mean()
        self._home = self._home or self._origin
        objection = self._not_back()
        self._go(Step.RESTED if objection is None else Step.DECIDED)
        self._sent = 1  # the first correction is zero, and need not be sent
        self._last, self._held = self._origin, 0.0
        self._areas, self._extents = [0.0] * len(self._origin), [0.0] * len(self._origin)
        return objection

    def _not_back(self) -> str | None:
        rows = zip(self._setup.axes, self._origin, self._home, self._size.amplitude, strict=True)
        for axis, now, home, far in rows:
            if abs(now - home) > _MOVED * far:
                return (
                    f"{axis.name} is measured {axis.shown * (now - home):.3f} {axis.unit} away from its "
                    f"start after its correction returned to zero: check that the KRC's program calls RSI_ON "
                    f"with mode {'relative' if self._setup.relative else 'absolute'}, and HOLDON in RECEIVE"
                )
        return None

    def _add(self, q: Joints, held: Joints, cycles: int) -> None:
        """Add a telegram to the sums; over missed telegrams by the trapezoidal rule."""
        moves = next(j for j, sign in enumerate(self._signs[self._round]) if sign)
        self._held += cycles * held[moves] / (self._size.amplitude[moves] * self._signs[self._round][moves])
        for j, (at, last, origin) in enumerate(zip(q, self._last, self._origin, strict=True)):
            y = at - origin if cycles == 1 else 0.5 * (at - origin + last - origin) * cycles
            self._areas[j] += y
            self._extents[j] += abs(y) - cycles * self._rest.noise[j]
        self._last = q
        self._missed += cycles - 1

    def _end_round(self) -> str | None:
        """Evaluate the round; go on with the next one if there is one."""
        self._sums.append(RoundSums(tuple(self._areas), tuple(self._extents), self._held))
        if self._round == 0:
            objection = self._evaluation.mode_objection(self._measurements())
            if objection is not None:
                self._go(Step.DECIDED)
                return objection
        self._round += 1
        if self._round < len(self._signs):
            self._go(Step.RESTED)
            return None
        self._go(Step.DECIDED)
        objections = map(self._evaluation.axis_objection, range(len(self._setup.axes)), self._measurements())
        return next((text for text in objections if text is not None), "")

    def _measurements(self) -> Sequence[Measurement]:
        return [
            self._evaluation.measurement(number, self._sums, max(noise, step), self._missed)
            for number, (noise, step) in enumerate(zip(self._rest.noise, self._size.resolution, strict=True))
        ]
