"""Hash of a cell: the same on every machine for the same cell."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from armgate.cell.bodies import Body
from armgate.cell.config import CellConfig
from armgate.cell.names import whole_name

if TYPE_CHECKING:
    from armgate.cell.cell import Robot


def cell_hash(config: CellConfig, robots: "Sequence[Robot]", bodies: Sequence[Body]) -> str:
    """Return SHA-256 of the resolved configuration and the composed URDFs.

    It covers values, not texts: comments, units, paths, and the server's address do not change it.
    """
    resolved = config.model_dump(mode="json", exclude={"server": True, "recording": True, "metrics": True})
    _replace_files(resolved, bodies)
    for robot in robots:
        own = resolved["robots"][robot.name]
        own["link"] = {
            key: value for key, value in own["link"].items() if key not in robot.config.link.UNHASHED
        }
        own["urdf"] = robot.urdf
        own["start"] = robot.start.tolist()
        bounds = (robot.lower, robot.upper, robot.velocity, robot.acceleration, robot.deceleration)
        own["joints"] = [[repr(float(value)) for value in bound] for bound in bounds]
    text = json.dumps(resolved, sort_keys=True, separators=(",", ":"))
    order = json.dumps([robot.name for robot in robots])
    return hashlib.sha256(f"{order}\n{text}".encode()).hexdigest()


def _replace_files(resolved: dict[str, Any], bodies: Sequence[Body]) -> None:
    """Replace mesh files by their convex parts; those of a robot are in its composed URDF."""
    for own in resolved["robots"].values():
        del own["meshes"]
        own["bodies"] = {name: body for name, body in own["bodies"].items() if "mesh" not in body["shape"]}
    for name, own in resolved["surroundings"].items():
        if "mesh" in own["shape"]:
            parts = (body for body in bodies if body.robot is None and whole_name(body.name) == name)
            own["shape"]["mesh"] = [(asdict(part.shape), part.placement.t.tolist()) for part in parts]
