"""What the KRC says of its robot: the values behind the elements of a telegram."""

from collections.abc import Iterable, Sequence

from armgate.emulator.krc.arm import Arm
from armgate.emulator.krc.kinematics import Pose
from armgate.emulator.krc.run import Run
from armgate.emulator.krc.telegram import Groups

CURRENT = 10.0
"""Motor current at an axis's full acceleration, A: nothing public says one (MACur, MECur)."""
_CARTESIAN = ("X", "Y", "Z", "A", "B", "C")


class Feedback:
    """Fills in what a file asks for; a real robot's programmed position stays while it is corrected.

    Args:
        arm: The robot.
        linear: Factor on the mm of linear external axes.
        needed: Which elements the file asks for.
        moves: The programmed position follows the correction.
    """

    def __init__(self, arm: Arm, linear: float, needed: Iterable[str], *, moves: bool = False) -> None:
        self._moves = moves
        self._arm = arm
        self._needed = frozenset(needed)
        self._scales = tuple(linear if axis.linear else 1.0 for axis in arm.axes)
        self._turning = sum(axis.name.startswith("A") for axis in arm.axes)
        self._solved: tuple[tuple[float, ...], Pose] | None = None

    def values(self, run: Run, measured: Sequence[float]) -> Groups:
        """All that can be asked for, in the units of telegrams."""
        shown = [scale * one for scale, one in zip(self._scales, measured, strict=True)]
        programmed = run.drives.setpoint if self._moves else run.programmed
        wanted = [scale * one for scale, one in zip(self._scales, programmed, strict=True)]
        currents = [CURRENT * share for share in run.drives.load]
        values = {"Delay": {"D": float(run.lateness.count)}}
        for inner, outer, numbers in (
            ("AIPos", "EIPos", shown), ("ASPos", "ESPos", wanted), ("MACur", "MECur", currents)
        ):  # fmt: skip
            named = dict(zip(self._arm.names, numbers, strict=True))
            values |= {inner: named, outer: named}
        if "RIst" in self._needed:
            values["RIst"] = self._named(self._pose(measured))
        if "RSol" in self._needed:
            values["RSol"] = self._named(self._programmed(programmed))
        return values

    def _pose(self, q: Sequence[float]) -> Pose:
        return self._arm.chain.pose(q[: self._turning])

    def _programmed(self, q: tuple[float, ...]) -> Pose:
        """It changes with each start only."""
        if self._solved is None or self._solved[0] != q:
            self._solved = (q, self._pose(q))
        return self._solved[1]

    def _named(self, pose: Pose) -> dict[str, float]:
        return dict(zip(_CARTESIAN, pose, strict=True))
