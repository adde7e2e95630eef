"""Profiles: the emulated kinds of KUKA controllers, as data.

Public figures are used if there are any: the cycle, the steps of the IPOC, the short first frame, the factor
of external axes and the lag of 120 ms come from drivers and simulators. All other figures are assumed;
the attributes of ``Profile`` and ``Tolerance`` state which.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from armgate.emulator.krc.errors import KrcError


@dataclass(frozen=True, slots=True)
class Tolerance:
    """Tolerance of a profile's drives (assumed figures).

    The velocity of a setpoint is compared with the axis's speed. Its acceleration passes a first-order
    low-pass before it is compared with the axis's acceleration, as the torque of a gear would. Motion within
    the axis's figures therefore never causes a fault, and a large enough step does. If a robot with the
    speed v is held for one cycle T (a lost reply, HOLDON 1), its velocity has a step of v, tolerated up to

        v = acceleration · a · T / (1 − exp(−T / filter))

    where a is the axis's acceleration.

    Attributes:
        velocity: Largest velocity, as a multiple of the axis's speed.
        acceleration: Largest filtered acceleration, as a multiple of the axis's acceleration.
        filter: Time constant of the low-pass, s.
    """

    velocity: float
    acceleration: float
    filter: float

    def step(self, acceleration: float, cycle: float) -> float:
        """Return the largest step of velocity that is tolerated in steady motion, by the formula above."""
        return self.acceleration * acceleration * cycle / -math.expm1(-cycle / self.filter)


@dataclass(frozen=True, slots=True)
class Profile:
    """One kind of controller.

    Attributes:
        name: Name, as in ``--profile``.
        about: Description.
        cycle: Time of a cycle, s.
        cycles: Possible times of a cycle, s.
        ipoc_step: Increment of the IPOC in a cycle of ``cycle``.
        ipoc_bits: Number of bits after which the IPOC wraps (assumed for 32 bits).
        ipoc_runs: True if the IPOC is a time that advances while nothing is sent; false if it counts
            telegrams.
        root: Name and value of the outer element's attribute.
        short_first: True if a frame with only the IPOC comes first. Drivers drop it, so a reply is accepted
            but not expected (assumed).
        linear_sent: Factor on the mm of linear external axes in telegrams; replies are always in mm.
        separate_external: True if an object of its own corrects external axes (AXISCORREXT), which is an
            error on a robot without such axes.
        lag: Time constant of the measured position, s.
        lags: Time constants of single axes that differ from ``lag``, by axis, s.
        reply_within: Time after the telegram until which a reply is accepted, s; at most the cycle.
        late_in_a_row: Tolerated number of consecutive late cycles (assumed); None: any number.
        late_share: Tolerated share of late cycles among the last 100 (assumed).
        tolerance: Tolerance of the drives.
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
        """Return the same controller with another cycle: 12 ms is that of #IPO on KRC4 and later.

        Raises:
            KrcError: The controller has no such cycle.
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
    """Return the profile of this name.

    Raises:
        KrcError: There is no such profile.
    """
    if name not in PROFILES:
        raise KrcError(f"there is no profile {name!r}; expected one of {', '.join(PROFILES)}")
    return PROFILES[name]
