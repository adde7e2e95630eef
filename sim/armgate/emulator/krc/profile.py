"""The controllers that can be stood in for, as data.

Where there are public figures they are used: cycle, steps of the IPOC, the short first frame, the external
axes' factor and the lag of 120 ms were seen with drivers and simulators. What nothing public says is assumed,
and the attributes of ``Profile`` and ``Tolerance`` say so.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from armgate.emulator.krc.errors import KrcError


@dataclass(frozen=True, slots=True)
class Tolerance:
    """What a profile's drives bear (assumed figures).

    A setpoint's velocity is held against the axis's speed. Its acceleration goes through a first-order
    low-pass before it is held against the axis's, as a gear's torque would: motion within the axis's
    figures never faults, and a step does when it is large enough. A robot that is held for one cycle T at the
    speed v (a lost reply, HOLDON 1) sees a step of v, and bears it up to

        v = acceleration · a · T / (1 − exp(−T / filter))

    with a the axis's acceleration.

    Attributes:
        velocity: Largest velocity, in the axis's own speed.
        acceleration: Largest filtered acceleration, in the axis's own.
        filter: Time constant of the low-pass, s.
    """

    velocity: float
    acceleration: float
    filter: float

    def step(self, acceleration: float, cycle: float) -> float:
        """The largest step of velocity that a drive bears from steady motion; see the formula above."""
        return self.acceleration * acceleration * cycle / -math.expm1(-cycle / self.filter)


@dataclass(frozen=True, slots=True)
class Profile:
    """One kind of controller.

    Attributes:
        name: How it is asked for.
        about: What it stands for.
        cycle: s.
        cycles: All cycles that it can run with, s.
        ipoc_step: Per cycle of ``cycle``.
        ipoc_bits: After how many bits it wraps (assumed for 32 bits).
        ipoc_runs: Whether it is a time that runs on while nothing is sent, or counts telegrams.
        root: The outer element's attribute.
        short_first: Whether a frame with nothing but the IPOC comes first. Drivers drop it, so an answer is
            taken but not expected (assumed).
        linear_sent: Factor on the mm of linear external axes from the KRC; to the KRC they are always mm.
        separate_external: Whether external axes are corrected by an object of its own (AXISCORREXT), which
            is an error on a robot without them.
        lag: Time constant of the measured position, s.
        lags: Time constants of axes that lag differently, by axis, s.
        reply_within: Until when a reply counts, s after its telegram; at most the cycle.
        late_in_a_row: So many late cycles in a row are borne (assumed); None: any number.
        late_share: So large a share of late cycles in the last 100 is borne (assumed).
        tolerance: Of the drives.
    """

    name: str
    about: str
    cycle: float
    cycles: tuple[float, ...]
    ipoc_step: int
    ipoc_bits: int
    ipoc_runs: bool
    root: tuple[str, str]
    short_first: bool
    linear_sent: float
    separate_external: bool
    lag: float
    reply_within: float
    late_in_a_row: int | None
    late_share: float
    tolerance: Tolerance
    lags: Mapping[str, float] = field(default_factory=dict)

    def lag_of(self, axis: str) -> float:
        """Return the time constant of an axis's measured position, s."""
        return self.lags.get(axis, self.lag)

    def in_cycle(self, cycle: float) -> "Profile":
        """The same controller with another cycle: 12 ms is what #IPO gives on KRC4 and later.

        Raises:
            KrcError: It has no such cycle.
        """
        if cycle not in self.cycles:
            known = " or ".join(f"{1000 * one:g}" for one in self.cycles)
            raise KrcError(f"{self.name} has no cycle of {1000 * cycle:g} ms; expected {known} ms")
        times = cycle / self.cycle
        step = round(self.ipoc_step * times) if self.ipoc_runs else self.ipoc_step
        return replace(self, cycle=cycle, ipoc_step=step, reply_within=self.reply_within * times)


_KRC2 = Profile(
    name="krc2-rsi2",
    about="KRC2 with RSI 2: counts telegrams, sends linear external axes as mm·180/π",
    cycle=0.012,
    cycles=(0.012,),
    ipoc_step=1,
    ipoc_bits=32,
    ipoc_runs=False,
    root=("TYPE", "KUKA"),
    short_first=True,
    linear_sent=180.0 / math.pi,
    separate_external=False,
    lag=0.12,
    reply_within=0.010,
    late_in_a_row=10,
    late_share=0.25,
    tolerance=Tolerance(velocity=1.1, acceleration=2.0, filter=0.040),
)
_KRC4 = Profile(
    name="krc4-rsi3",
    about="KRC4 with RSI 3: an IPOC in ms, linear external axes in mm",
    cycle=0.004,
    cycles=(0.004, 0.012),
    ipoc_step=4,
    ipoc_bits=64,
    ipoc_runs=True,
    root=("Type", "KUKA"),
    short_first=False,
    linear_sent=1.0,
    separate_external=True,
    lag=0.03,
    reply_within=0.004,
    late_in_a_row=None,
    late_share=1.0,
    tolerance=Tolerance(velocity=1.1, acceleration=2.0, filter=0.030),
)
_KRC5 = replace(_KRC4, name="krc5-rsi5", about="KRC5 with RSI 5: as KRC4")

PROFILES = {profile.name: profile for profile in (_KRC2, _KRC4, _KRC5)}


def profile_named(name: str) -> Profile:
    """The profile of this name.

    Raises:
        KrcError: There is none.
    """
    if name not in PROFILES:
        raise KrcError(f"there is no profile {name!r}; expected one of {', '.join(PROFILES)}")
    return PROFILES[name]
