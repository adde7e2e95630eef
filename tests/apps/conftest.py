"""States and descriptions as a daemon of the demo cell would send them."""

import json
import math
from collections.abc import Callable
from typing import Any

import pytest

from armgate.client import Description, State

ARM = [("A1", "revolute", "rad", 2.7), ("A2", "revolute", "rad", 2.7)]
CARRIAGE = [("X", "prismatic", "m", 1.0)]
UNITS = {"FR": ARM, "GR": CARRIAGE + ARM}


def robot(name: str, joints: list[tuple[str, str, str, float]], camera: str | None) -> dict[str, Any]:
    return {
        "name": name,
        "urdf": {"hash": "0" * 64, "size": 1, "media": "application/xml"},
        "joints": [
            {
                "name": joint, "kind": kind, "unit": unit, "lower": -3.0, "upper": 3.0,
                "velocity": speed, "acceleration": 4 * speed, "deceleration": 4 * speed,
            }
            for joint, kind, unit, speed in joints
        ],
        "base_xyz": [0.0, 0.0, 0.0],
        "base_xyzw": [0.0, 0.0, 0.0, 1.0],
        "period": 0.012,
        "start": [0.0] * len(joints),
        "frames": ["tool0"],
        "tool": "tool0",
        "camera": camera,
    }  # fmt: skip


class Clock:
    """Clock that a test advances."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        return self.time


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def description() -> Description:
    return Description.model_validate_json(
        json.dumps(
            {
                "name": "demo", "hash": "0" * 64, "stop_distance": 0.05, "self_distance": 0.02,
                "response": "stop", "lockstep": False, "bodies": [],
                "robots": [robot("FR", ARM, "camera"), robot("GR", CARRIAGE + ARM, None)],
            }
        )
    )  # fmt: skip


@pytest.fixture
def make_state() -> Callable[..., State]:
    """Return a factory of states at a tick of FR; keywords change their content."""

    def make(
        tick: int,
        *,
        robot: str = "FR",
        angle: float | None = 0.0,
        distance: float = 0.0,
        progress: float = 0.0,
        clearance: float = 0.4,
        least: float = 0.3,
        counts: dict[str, int] | None = None,
        late: int = 0,
        warnings: tuple[str, ...] = (),
        near: tuple[tuple[str, str, float, float], ...] = (),
    ) -> State:
        time = 100.0 + 0.012 * tick
        signals = {"lead.progress": (progress,)}
        if angle is not None:
            signals |= {
                "follow.angle_error": (math.radians(angle),),
                "follow.distance_error": (distance,),
                "follow.distance": (1.0,),
                "follow.focus": (2.0, 0.1, 1.0),
                "follow.repulsion": (0.0,),
            }
        nearest = [("FR/link_5", "GR/link_6", clearance, 0.05), *near]
        verdict = {"seq": tick, "outcome": "refused", "cause": "clearance", "text": "too near"}
        entry = {
            "tick": tick, "time": time, "setpoint": None, "holder": "follower", "link": "ready",
            "nearest": tuple({"pair": (a, b), "distance": d, "limit": limit} for a, b, d, limit in nearest),
            "verdict": verdict if near else None,
            "least_clearance": least, "counts": counts or {"admitted": tick}, "late_commands": late,
        }  # fmt: skip
        return State.model_validate(
            {
                "robot": robot, "tick": tick, "time": time, "warnings": warnings,
                "entries": (
                    {"robot": "FR", "q": (0.5, -1.0), **entry},
                    {"robot": "GR", "q": (2.93, 0.5, -1.0), **entry},
                ),
                "signals": {
                    name: {"owner": "x", "value": value, "time": time} for name, value in signals.items()
                },
            }
        )  # fmt: skip

    return make
