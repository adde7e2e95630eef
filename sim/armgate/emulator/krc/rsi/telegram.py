"""Telegrams (``<Rob>``): values of the robot's state, written in the order of the KRC's file."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, assert_never
from xml.sax.saxutils import escape

from armgate.emulator.krc.robot.arm import Arm
from armgate.emulator.krc.robot.kinematics import Pose
from armgate.emulator.krc.rsi.ethernet import CARTESIAN, ZERO, Element, Ethernet

if TYPE_CHECKING:
    from armgate.emulator.krc.rsi_run import RsiRun

Groups = Mapping[str, Mapping[str, float]]
"""Values of the KRC, by tag and attribute; a missing value is sent as zero."""

CURRENT = 10.0
"""Motor current at an axis's full acceleration, A (assumed: no public source has MACur or MECur)."""


class TelegramValues:
    """Values of a telegram, computed from the state of the robot.

    Args:
        arm: The robot.
        linear: Factor on the mm of linear external axes.
        needed: Tags that the file declares.
        moves: True if the programmed position follows the correction; that of a real robot does not.
    """

    def __init__(self, arm: Arm, linear: float, needed: Iterable[str], *, moves: bool = False) -> None:
        self._moves = moves
        self._arm = arm
        self._needed = frozenset(needed)
        self._scales = tuple(linear if axis.linear else 1.0 for axis in arm.axes)
        self._turning = sum(axis.name.startswith("A") for axis in arm.axes)
        self._programmed_pose: tuple[tuple[float, ...], Pose] | None = None

    def of(self, run: "RsiRun", measured: Sequence[float]) -> Groups:
        """Return all values that a file can declare, in the units of telegrams."""
        shown = [scale * one for scale, one in zip(self._scales, measured, strict=True)]
        programmed = run.drives.setpoint if self._moves else run.programmed
        wanted = [scale * one for scale, one in zip(self._scales, programmed, strict=True)]
        currents = [CURRENT * share for share in run.drives.load]
        values = {"Delay": {"D": float(run.delay.count)}}
        for inner, outer, numbers in (
            ("AIPos", "EIPos", shown), ("ASPos", "ESPos", wanted), ("MACur", "MECur", currents)
        ):  # fmt: skip
            named = dict(zip(self._arm.names, numbers, strict=True))
            values |= {inner: named, outer: named}
        if "RIst" in self._needed:
            values["RIst"] = _named(self._pose(measured))
        if "RSol" in self._needed:
            values["RSol"] = _named(self._pose_of_programmed(programmed))
        return values

    def _pose(self, q: Sequence[float]) -> Pose:
        return self._arm.chain.pose(q[: self._turning])

    def _pose_of_programmed(self, q: tuple[float, ...]) -> Pose:
        """Return the pose of the programmed position, which usually changes only with each start."""
        if self._programmed_pose is None or self._programmed_pose[0] != q:
            self._programmed_pose = (q, self._pose(q))
        return self._programmed_pose[1]


def _named(pose: Pose) -> dict[str, float]:
    return dict(zip(CARTESIAN, pose, strict=True))


class TelegramWriter:
    """Writer of telegrams: the elements of SEND in the file's order, then Delay if it is sent, then IPOC.

    Args:
        ethernet: Content of the file.
        precision: Decimals of every DOUBLE, as on a real KRC.
        root: Name and value of the outer element's attribute, which differs between controllers.
    """

    def __init__(self, ethernet: Ethernet, precision: int, root: tuple[str, str]) -> None:
        self._open = f'<Rob {root[0]}="{root[1]}">'
        self._precision = precision
        groups: dict[str, list[Element]] = {}
        for element in sorted(ethernet.sent, key=lambda element: element.tag == "Delay"):
            groups.setdefault(element.tag, []).append(element)
        self._groups = list(groups.items())
        self.needed = frozenset(groups)
        """Tags that the file declares."""

    def write(self, values: Groups, ipoc: int) -> bytes:
        """Return a telegram."""
        inner = "".join(self._group(tag, elements, values.get(tag, {}).get) for tag, elements in self._groups)
        return f"{self._open}{inner}<IPOC>{ipoc}</IPOC></Rob>".encode()

    def short(self, ipoc: int) -> bytes:
        """Return the first frame of RSI 2, which contains only the IPOC."""
        return f"{self._open}<IPOC>{ipoc}</IPOC></Rob>".encode()

    def _group(self, tag: str, elements: list[Element], value: Callable[[str], float | None]) -> str:
        texts = [(element.attribute, self._text(element, value(element.attribute))) for element in elements]
        attributes = "".join(f' {name}="{text}"' for name, text in texts if name)
        # A file may declare the text of an element in addition to its attributes.
        content = "".join(escape(text) for name, text in texts if not name)
        return (
            f"<{tag}{attributes}/>"
            if all(name for name, _ in texts)
            else f"<{tag}{attributes}>{content}</{tag}>"
        )

    def _text(self, element: Element, value: float | None) -> str:
        given = ZERO[element.type] if value is None else value
        match element.type:
            case "DOUBLE":
                return f"{given:.{self._precision}f}"
            case "STRING":
                return str(given)
            case "BOOL" | "LONG":
                return str(int(given))
            case _:
                assert_never(element.type)
