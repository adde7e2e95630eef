"""Probe of the KRC's corrections: small motions that prove mode, axes and scale before anything else moves.

A correction w_k is the whole offset in absolute mode and is added up in relative mode. The first round sends
a wave whose sum is zero and which ends at zero. A KRC of either mode therefore ends where it began, whether
its feedback works or not, and zeros hold it afterwards. The two modes differ in the area below the measured
offset y, which no lag changes:

    relative: Σ y = g · Σ_k Σ_{i≤k} w_i        absolute: Σ y = 0, and y is not zero

The rounds after it prove order, direction and scale. In round r axis number j moves by digit r of j + 1 in
balanced ternary (-1, 0 or 1). No two axes have the same digits, and none has those of another one reversed,
so that a swapped axis and a reversed one are told apart. The gain g is the area's share of what was
commanded.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING

from armgate.events import Joints
from armgate.links.rsi.axes import Axis
from armgate.links.rsi.ipoc_and_delay import Follows

if TYPE_CHECKING:  # a setup has the size of its probe
    from armgate.links.rsi.setup import Setup

_EXCURSION = {False: math.radians(0.1), True: 1e-4}
"""Largest offset of a KRC of either mode (rad; m for linear axes); tolerance and resolution may change it."""
_UNREST = {False: math.radians(1e-4), True: 1e-7}
"""Motion of a robot at rest that no finer telegram makes visible (rad; m), assumed."""
_SHORTEST, _LONGEST = 4, 64
"""Telegrams in half a wave."""
_VISIBLE, _BARELY = 25.0, 8.0
"""Amplitude that is wanted, and the smallest one that is used, in steps of the telegrams' last decimal."""
_STILL = 8
"""Telegrams for which the position of a robot that rests stays the same."""
_TAIL, _REST = 0.001, 0.1
"""Motion within these telegrams that counts as rest; the same if it does not end, as noise, in amplitudes."""
_NOISE = 0.02
"""Motion of a robot at rest that a reference is not taken anew for, in tolerances."""
_NOISY = 128
"""Telegrams after which motion that does not end is taken for noise."""
_PATIENCE = 30.0
"""The probe has to end within this time, s."""
_MOVED = 0.8
"""Distance between two rounds at which a robot has not come back, in amplitudes."""
_STIRS = 0.05
"""Share of the wave's extent, beyond noise, from which on an axis is taken to follow."""
_ADDS = 0.3
"""Share of a relative KRC's area from which on an axis is taken to add up."""
_MATCHES = 0.25
"""Largest error of a round's share, in gains."""
_EXACT, _COARSE = 0.05, 36.0
"""Error of a gain that is accepted: so much, and so many steps of the position in the area of a round."""
_GAP = 0.05
"""The same for each telegram that was missed."""


class Stage(StrEnum):
    """What the probe does.

    ``resting``: wait until the robot is measured to rest. ``wave``: send a round's corrections. ``back``: a
    telegram or reply was lost; return to where the round began. ``settling``: wait until it rests again.
    ``done``: nothing is left to send.
    """

    RESTING = "resting"
    WAVE = "wave"
    BACK = "back"
    SETTLING = "settling"
    DONE = "done"


@dataclass(frozen=True, slots=True)
class Shape:
    """Size of the probe.

    Attributes:
        half: Telegrams in half a wave.
        amplitude: Of each axis, rad or m.
        resolution: Of each axis's measured position, rad or m.
        farthest: How far a KRC of either mode moves each axis, rad or m.
    """

    half: int
    amplitude: Joints
    resolution: Joints
    farthest: Joints

    def objection(self, axes: Sequence[Axis], precision: int) -> str | None:
        """Return why the probe would be invisible in telegrams, None if it is visible."""
        for axis, amplitude, step in zip(axes, self.amplitude, self.resolution, strict=True):
            if amplitude < _BARELY * step:
                at, of = axis.shown * amplitude, axis.shown * step
                return (
                    f"a probe of {axis.name} by {at:.2g} {axis.unit} is not visible in steps of {of:.2g} "
                    f"{axis.unit} (precision {precision}): the mode of the KRC could not be proven; expected "
                    f"precision {precision + 1} or more, on the KRC too, or a wider tolerance"
                )
        return None


def shape_of(setup: "Setup") -> Shape:
    """Return the shortest probe that shows in telegrams, within what tolerance, speed and acceleration allow.

    A short one is seldom disturbed by a lost telegram, a long one is damped less by the lag.
    """
    half = _SHORTEST
    best = _shape(setup, half)
    while half < _LONGEST and _visibility(setup, best) < _VISIBLE:
        half = min(half + half // 2, _LONGEST)
        best = max(best, _shape(setup, half), key=lambda shape: _visibility(setup, shape))
    return best


def _visibility(setup: "Setup", shape: Shape) -> float:
    """Return the smallest measured amplitude, in steps of telegrams or of what a robot at rest shows."""
    damping = min(shape.half * setup.period / (math.pi * max(setup.lag, 1e-9)), 1.0)
    rows = zip(setup.axes, shape.amplitude, shape.resolution, strict=True)
    return damping * min(far / max(step, _UNREST[axis.linear]) for axis, far, step in rows)


def _shape(setup: "Setup", half: int) -> Shape:
    first, total = math.sin(math.pi / half), 1.0 / math.tan(math.pi / (2 * half))
    rows = zip(setup.axes, setup.tolerance, setup.speed, setup.acceleration, strict=True)
    amplitudes, steps = [], []
    for axis, tolerance, speed, acceleration in rows:
        step = 10.0**-setup.precision * abs(axis.read)
        wanted = max(_EXCURSION[axis.linear] / total, _VISIBLE * step)
        hardest = 0.5 * acceleration * setup.period**2 / first
        amplitudes.append(min(wanted, 0.5 * tolerance / total, hardest, 0.5 * speed * setup.period))
        steps.append(step)
    return Shape(half, tuple(amplitudes), tuple(steps), tuple(total * one for one in amplitudes))


def digits_of(number: int, rounds: int) -> tuple[int, ...]:
    """Return a number in balanced ternary, the lowest digit first."""
    digits = []
    for _ in range(rounds):
        digit = (number + 1) % 3 - 1
        digits.append(digit)
        number = (number - digit) // 3
    return tuple(digits)


@dataclass(frozen=True, slots=True)
class Finding:
    """What one axis did in the rounds.

    Attributes:
        adds: Area in the first round, as a share of a relative KRC's.
        stirs: Extent of the motion in the first round beyond noise, as a share of the wave's.
        shares: Area in each later round, as a share of what the cell's mode says.
        error: Error of a share that is accepted.
    """

    adds: float
    stirs: float
    shares: tuple[float, ...]
    error: float


class Probe:
    """Sends the rounds and judges what is measured.

    Args:
        setup: Robot and KRC.
    """

    def __init__(self, setup: "Setup") -> None:
        self._setup = setup
        self._shape = shape_of(setup)
        count = len(setup.axes)
        rounds = next(n for n in range(1, 4) if 3**n // 2 >= count)
        codes = [digits_of(number + 1, rounds) for number in range(count)]
        self.codes = tuple(codes)
        self._signs = [(1,) * count, *zip(*codes, strict=True)]
        wave = [math.sin(math.pi * k / self._shape.half) for k in range(2 * self._shape.half)]
        added = [*(math.fsum(wave[: k + 1]) for k in range(len(wave) - 1)), 0.0]
        # Commanded offsets, in amplitudes. In the first round they are the same corrections in either mode.
        self._forms = [added if setup.relative else wave, *[added] * rounds]
        self._area, self._extent = math.fsum(added), math.fsum(map(abs, wave))
        self.begin()

    def begin(self) -> None:
        """Begin with the first round."""
        self.stage = Stage.RESTING
        self._round = 0
        self._since: float | None = None
        self._sums: list[tuple[list[float], list[float], float]] = []
        self._noise = [0.0] * len(self._setup.axes)
        self._home: Joints = ()
        self._missed = 0
        self._rest()

    # --- a telegram ---------------------------------------------------------------------------------------

    def take(self, q: Joints, held: Joints, follows: Follows, now: float) -> str | None:
        """Take a telegram over.

        What a KRC held when replies or telegrams were lost depends on mode and HOLDON. So a first round that
        is disturbed begins anew. Once the mode is proven, what was held is known and counted instead.

        Args:
            q: Measured position.
            held: Offset from the reference that the KRC has held since the last telegram.
            follows: How the telegram follows the last one.
            now: Time, s.

        Returns:
            Empty if the KRC does what the cell says, a text if it does not, None while that is open.
        """
        self._since = now if self._since is None else self._since
        if self.stage is Stage.WAVE:
            self._follow(follows)
        if self.stage in (Stage.WAVE, Stage.SETTLING):
            self._add(q, held, follows.missed + 1)
        if self._rests(q):
            if self.stage is Stage.RESTING:
                return self._start()
            if self.stage is Stage.SETTLING:
                return self._end()
        if now - self._since > _PATIENCE:
            return (
                "the robot does not rest, or telegrams or replies are lost too often to prove the KRC's mode"
            )
        return None

    def moved(self, before: Joints, now: Joints) -> bool:
        """Return True if two positions differ by more than rounding and the noise of a robot at rest."""
        rows = zip(before, now, self._shape.resolution, self._setup.tolerance, strict=True)
        return any(abs(a - b) > max(1.01 * step, _NOISE * far) for a, b, step, far in rows)

    def target(self, reference: Joints, setpoint: Joints, going: bool) -> Joints:
        """Return where to command the robot now: on the round's way if ``going``, else back step by step."""
        if self.stage is Stage.WAVE and going:
            form = self._forms[self._round]
            place = form[self._sent] if self._sent < len(form) else 0.0
            self._sent += 1
            signs = self._signs[self._round]
            rows = zip(reference, signs, self._shape.amplitude, strict=True)
            return tuple([origin + sign * far * place for origin, sign, far in rows])
        step = math.sin(math.pi / self._shape.half)
        rows = zip(reference, setpoint, self._shape.amplitude, strict=True)
        near = tuple(
            [
                origin if abs(origin - at) <= step * far else at + math.copysign(step * far, origin - at)
                for origin, at, far in rows
            ]
        )
        if self.stage is Stage.BACK and near == reference:
            self.stage = Stage.RESTING
            self._rest()
        return near

    def _follow(self, follows: Follows) -> None:
        """Go on with the wave, send again what was not taken, or begin anew."""
        disturbed = follows.late or follows.missed
        if disturbed and self._round == 0:
            self.stage = Stage.BACK
        elif follows.late > follows.missed:
            self._sent -= 1
        elif self._sent > len(self._forms[self._round]):
            self.stage = Stage.SETTLING
            self._rest()

    def _rest(self) -> None:
        self._still: list[Joints] = []
        self._waited = 0

    def _rests(self, q: Joints) -> bool:
        """Return True if the position has stayed the same, apart from noise that was there before."""
        if self.stage not in (Stage.RESTING, Stage.SETTLING):
            return False
        self._still = [*self._still[1 - _STILL :], q]
        self._waited += 1
        if len(self._still) < _STILL:
            return False
        spread = [max(column) - min(column) for column in zip(*self._still, strict=True)]
        noisy = self._waited > _NOISY
        steps = self._shape.resolution if noisy else self._noise
        rows = zip(spread, self._shape.amplitude, steps, strict=True)
        share = _REST if noisy else _TAIL
        if any(far > max(share * amplitude, 1.01 * step) for far, amplitude, step in rows):
            return False
        if self.stage is Stage.RESTING:
            self._noise = [max(a, b) for a, b in zip(spread, self._noise, strict=True)]
        return True

    def _start(self) -> str | None:
        """Begin a round, unless the robot is not measured where it was before the last one."""
        columns = zip(*self._still, strict=True)
        self._origin = tuple(math.fsum(column) / len(column) for column in columns)
        self._home = self._home or self._origin
        rows = zip(self._setup.axes, self._origin, self._home, self._shape.amplitude, strict=True)
        for axis, now, home, far in rows:
            if abs(now - home) > _MOVED * far:
                self.stage = Stage.DONE
                return (
                    f"{axis.name} is measured {axis.shown * (now - home):.3f} {axis.unit} off after its "
                    f"correction was taken back: does the KRC's program call RSI_ON with another mode than "
                    f"{'relative' if self._setup.relative else 'absolute'}, or has RECEIVE another HOLDON?"
                )
        self.stage = Stage.WAVE
        self._sent = 1  # the first one is zero
        self._last, self._held = self._origin, 0.0
        self._areas, self._extents = [0.0] * len(self._origin), [0.0] * len(self._origin)
        return None

    def _add(self, q: Joints, held: Joints, cycles: int) -> None:
        moves = next(j for j, sign in enumerate(self._signs[self._round]) if sign)
        self._held += cycles * held[moves] / (self._shape.amplitude[moves] * self._signs[self._round][moves])
        for j, (at, last, origin) in enumerate(zip(q, self._last, self._origin, strict=True)):
            y = at - origin if cycles == 1 else 0.5 * (at - origin + last - origin) * cycles
            self._areas[j] += y
            self._extents[j] += abs(y) - cycles * self._noise[j]
        self._last = q
        self._missed += cycles - 1

    # --- what it means ------------------------------------------------------------------------------------

    def _end(self) -> str | None:
        """Judge the round; go on with the next one if there is one."""
        self._sums.append((self._areas, self._extents, self._held))
        if self._round == 0:
            mode = self._mode()
            if mode is not None:
                self.stage = Stage.DONE
                return mode
        self._round += 1
        if self._round < len(self._signs):
            self.stage = Stage.RESTING
            return None
        self.stage = Stage.DONE
        objections = (self._axis(number) for number in range(len(self._setup.axes)))
        return next((text for text in objections if text is not None), "")

    def _finding(self, number: int) -> Finding:
        amplitude = self._shape.amplitude[number]
        step = max(self._noise[number], self._shape.resolution[number])
        (areas, extents, _), *later = self._sums
        return Finding(
            adds=areas[number] / (amplitude * self._area),
            stirs=extents[number] / (amplitude * self._extent),
            shares=tuple(sums[number] / (amplitude * held) for sums, _, held in later),
            error=_EXACT + _GAP * self._missed + _COARSE * step / (amplitude * self._area),
        )

    def _mode(self) -> str | None:
        """Return what the first round says against the cell's mode."""
        relative = self._setup.relative
        for number, axis in enumerate(self._setup.axes):
            found = self._finding(number)
            adds = abs(found.adds) > _ADDS
            if adds and not relative:
                return (
                    f"{axis.name} adds corrections up: the KRC's program calls RSI_ON(#RELATIVE), the cell "
                    f"says mode: absolute. Make them the same, and start the program anew"
                )
            if not adds and found.stirs < _STIRS:
                return self._silent(number)
            if not adds and relative:
                return (
                    f"{axis.name} takes a correction for the whole offset: the KRC's program calls "
                    f"RSI_ON(#ABSOLUTE), the cell says mode: relative. Make them the same, and start the "
                    f"program anew"
                )
        return None

    def _silent(self, number: int) -> str:
        axis, far = self._setup.axes[number], self._shape.amplitude[number]
        return (
            f"{axis.name} is not measured to follow a correction of {axis.shown * far:.2g} {axis.unit}: has "
            f"RECEIVE on the KRC other tags, is the feedback frozen, or has it fewer decimals than "
            f"precision: {self._setup.precision}? Then start the program anew"
        )

    def _axis(self, number: int) -> str | None:
        """Return what the later rounds say against an axis."""
        axis, found = self._setup.axes[number], self._finding(number)
        gain, misfit = _fit(found.shares, self.codes[number])
        if gain > 0.0 and misfit <= _MATCHES:
            return None if abs(gain - 1.0) <= found.error else scale_objection(axis, gain)
        for other, code in zip(self._setup.axes, self.codes, strict=True):
            gain, misfit = _fit(found.shares, code)
            if abs(gain) < _MATCHES or misfit > _MATCHES:
                continue
            if other is axis:
                return (
                    f"{axis.name} is measured to move against its correction: expected "
                    f"axes.{axis.name}.received and sent to have the same sign"
                )
            return (
                f"{axis.name} is measured to move when {other.name} is corrected: expected the same order of "
                f"axes in RECEIVE, in the KRC's signal flow and in axes"
            )
        return self._silent(number)


def scale_objection(axis: Axis, gain: float) -> str:
    """Return what to say of an axis that moves by another factor than commanded."""
    received, sent = axis.received * gain, axis.sending / gain
    return (
        f"{axis.name} ({axis.joint}) is measured to move by {gain:.3f} of what is commanded: expected "
        f"axes.{axis.name}.received {received:.6g} instead of {axis.received:.6g}, or sent {sent:.6g} "
        f"instead of {axis.sending:.6g}"
    )


def _fit(shares: Sequence[float], code: Sequence[int]) -> tuple[float, float]:
    """Return the gain with which a code explains the shares, and the largest error in gains (at least 1)."""
    gain = sum(a * b for a, b in zip(shares, code, strict=True)) / sum(b * b for b in code)
    errors = [abs(a - gain * b) for a, b in zip(shares, code, strict=True)]
    return gain, max(errors) / max(abs(gain), 1.0)
