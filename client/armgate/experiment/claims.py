"""Claims of the paper and of its future work, checked against the figures of all runs."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

Entry = Mapping[str, Any]


@dataclass(frozen=True)
class Claim:
    """Claim with its goal in words, its figure, and its outcome (None: not checked).

    Attributes:
        paper: Result that the paper reports, in words; "" if none.
    """

    claim: str
    goal: str
    value: float | None
    unit: str
    holds: bool | None
    paper: str = ""

    def row(self) -> dict[str, Any]:
        """Return the claim as in ``metrics.json``."""
        return dict(vars(self))

    @property
    def text(self) -> str:
        """Figure as text, "–" without one."""
        return "–" if self.value is None else worded(self.value, self.unit)


def digits(value: float) -> str:
    """Return three significant digits, and all digits before the decimal point."""
    return f"{value:.3g}" if abs(value) < 999.5 else f"{value:.0f}"


def worded(value: float, unit: str = "") -> str:
    """Return a figure with its unit: three digits, lengths in mm; counts as integers."""
    match unit:
        case "m":
            return f"{digits(1000.0 * value)} mm"
        case "°":
            return f"{digits(value)}°"
        case "commands" | "states":
            return f"{value:.0f}"
        case _:
            return f"{digits(value)} {unit}".strip()


def claims(experiment: str, entries: Sequence[Entry]) -> list[Claim]:
    """Return the claims of an experiment; ``entries`` are its runs in ``metrics.json``."""
    rows = list(_OF[experiment](entries)) if entries else []
    return [*rows, *_always(entries)]


def at_most(claim: str, values: Iterable[float | None], bound: float, unit: str, paper: str = "") -> Claim:
    """Return the claim that no value exceeds a bound; a run without a value counts as exceeding it."""
    found = list(values)
    known = [value for value in found if value is not None]
    holds = bool(found) and len(known) == len(found) and max(known) <= bound
    goal = f"≤ {worded(bound, unit)}" if bound > 0.0 else "none"
    return Claim(claim, goal, max(known, default=None), unit, holds if found else None, paper)


def _of(entries: Sequence[Entry], case: str) -> list[Entry]:
    return [entry for entry in entries if entry["case"] == case]


def _errors(entries: Sequence[Entry], case: str, kind: str, what: str) -> list[float | None]:
    return [entry[kind][what] for entry in _of(entries, case)]


def _always(entries: Sequence[Entry]) -> list[Claim]:
    if not entries:
        return []
    stop = entries[0]["stop_distance_m"]
    least = [entry["min_clearance_m"] for entry in entries]
    worst = min((value for value in least if value is not None), default=None)
    near = Claim(
        "certified clearance to others and surroundings", f"≥ {worded(stop, 'm')}", worst, "m",
        None not in least and worst is not None and worst >= stop,
    )  # fmt: skip
    late = [float(entry["late_commands"]) for entry in entries]
    missed = [float(sum(entry["states_missed"].values())) for entry in entries]
    return [
        near,
        at_most("late commands", late, 0.0, "commands"),
        at_most("states missing in the figures", missed, 0.0, "states"),
    ]


_BANDS = (
    ("slow", "0.25 m/s, no lag, without prediction", 1.0, 0.02, ("± 1°", "± 2 cm")),
    ("slow-lag30", "0.25 m/s, 30 ms lag, without prediction", 1.0, 0.02, ("± 1°", "± 2 cm")),
    ("fast-predicted", "0.5 m/s, no lag, with prediction", 0.2, 0.005, ("", "")),
    ("fastest-predicted", "1.0 m/s, no lag, with prediction", 0.5, 0.01, ("", "")),
)
_PAIRS = (("slow", "0.25"), ("fast", "0.5"), ("fastest", "1.0"))


def _tracking(entries: Sequence[Entry]) -> Iterable[Claim]:
    for case, text, angle, distance, paper in _BANDS:
        angles = _errors(entries, case, "angle_error_deg", "max")
        yield at_most(f"{text}: angle", angles, angle, "°", paper[0])
        distances = _errors(entries, case, "distance_error_m", "max")
        yield at_most(f"{text}: distance", distances, distance, "m", paper[1])
    for case, speed in _PAIRS:
        ratios = _ratios(entries, case, f"{case}-predicted")
        yield at_most(f"{speed} m/s: ratio of the RMS angles with and without prediction", ratios, 1 / 3, "")
    rms = _errors(entries, "slow-lag120-predicted", "angle_error_deg", "rms")
    yield at_most("0.25 m/s, 120 ms lag, with prediction: RMS angle", rms, 0.3, "°")


def _ratios(entries: Sequence[Entry], without: str, with_: str) -> list[float | None]:
    before = {entry["seed"]: entry["moving_rms_deg"] for entry in _of(entries, without)}
    after = {entry["seed"]: entry["moving_rms_deg"] for entry in _of(entries, with_)}
    return [
        after[seed] / before[seed] if after[seed] is not None and before[seed] else None
        for seed in sorted(before.keys() & after.keys())
    ]


def _approach(entries: Sequence[Entry]) -> Iterable[Claim]:
    far, limit = _of(entries, "approach"), _of(entries, "limit")
    rises = (e["rise_deg"] for e in far)
    yield at_most("approach from 30° to 150°: the angle rises by", rises, 0.05, "°", "falls monotonically")
    yield at_most("approach: settled (0.1°, 2 mm) after", (e["settled_s"] for e in far), 3.0, "s")
    yield at_most("from 0.999 of a joint limit: reached after", (e["settled_s"] for e in limit), 10.0, "s")
    motion = (e["end_motion_rad"] for e in limit)
    yield at_most("from a joint limit: joint motion in the last second", motion, 1e-3, "rad")


def _zoom(entries: Sequence[Entry]) -> Iterable[Claim]:
    yield at_most("angle while zooming", (e["zoom_angle_deg"] for e in entries), 0.5, "°", "unaffected")
    yield at_most(
        "distance error after repulsion has been inactive for 2 s",
        (e["quiet_distance_m"] for e in entries), 0.02, "m", "not reached while repulsion acts",
    )  # fmt: skip
    share = sum(e["quiet_share"] for e in entries) / len(entries)
    yield Claim(
        "share of the time in which repulsion has been inactive for 2 s", "≥ 0.5", share, "", share >= 0.5
    )


def _collision(entries: Sequence[Entry]) -> Iterable[Claim]:
    for case in sorted({entry["case"] for entry in entries}):
        own, (kind, speed) = _of(entries, case), case.split("-")
        text = f"{kind} at {speed} m/s"
        if kind == "dash":
            refused = _share(own, "follower_refused")
            yield at_most(f"{text}: share of runs in which the follower is refused", [refused], 0.1, "")
            free = [e["free_angle_deg"] for e in own]
            words = f"{text}: angle, except while equation (13) or the gate acts, and 2 s afterwards"
            yield at_most(words, free, 1.0, "°", "kept while equation (13) is inactive")
        else:
            yield _reported(
                own, f"{text}: share of runs in which the follower is refused", "follower_refused"
            )
        yield _reported(own, f"{text}: share of runs in which the leader is refused", "leader_refused")


def _share(entries: Sequence[Entry], what: str) -> float:
    return sum(bool(entry[what]) for entry in entries) / len(entries)


def _reported(entries: Sequence[Entry], text: str, what: str) -> Claim:
    return Claim(text, "reported", _share(entries, what), "", None)


_OF = {"tracking": _tracking, "approach": _approach, "zoom": _zoom, "collision": _collision}


def aggregate(entries: Sequence[Entry]) -> dict[str, Any]:
    """Return sums by case: number of runs, worst errors and clearance, verdicts, and speed."""
    return {case: _sum_up(_of(entries, case)) for case in dict.fromkeys(e["case"] for e in entries)}


def _sum_up(entries: Sequence[Entry]) -> dict[str, Any]:
    def worst(kind: str) -> dict[str, float | None]:
        return {
            what: max((e[kind][what] for e in entries if e[kind][what] is not None), default=None)
            for what in ("max", "rms")
        }

    clearances = [e["min_clearance_m"] for e in entries if e["min_clearance_m"] is not None]
    seconds = sum(e["duration_s"] for e in entries)
    wall = sum(e["duration_s"] / e["realtime_factor"] for e in entries if e["realtime_factor"])
    return {
        "runs": len(entries),
        "angle_error_deg": worst("angle_error_deg"),
        "distance_error_m": worst("distance_error_m"),
        "min_clearance_m": min(clearances, default=None),
        "late_commands": sum(e["late_commands"] for e in entries),
        "limited": _verdicts(entries, "limited"),
        "refused": _verdicts(entries, "refused"),
        "realtime_factor": seconds / wall if wall else None,
    }


def _verdicts(entries: Sequence[Entry], outcome: str) -> dict[str, int]:
    """Return the number of commands by robot."""
    found: dict[str, int] = {}
    for entry in entries:
        for robot, verdicts in entry["verdicts"].items():
            found[robot] = found.get(robot, 0) + sum(verdicts[outcome].values())
    return found
