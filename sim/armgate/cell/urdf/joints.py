"""Reading of ``<joint>`` elements."""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence

from armgate.cell.errors import ModelError
from armgate.cell.urdf.description import JointKind, UrdfJoint
from armgate.cell.urdf.elements import name_of, numbers, placement_of

_KINDS: dict[str, JointKind] = {"revolute": "revolute", "prismatic": "prismatic", "fixed": "fixed"}


def read_joint(element: ET.Element, links: Sequence[str]) -> UrdfJoint:
    """Return the joint of an element.

    Raises:
        ModelError: It is malformed, of an unsupported kind, or connects a link that does not exist.
    """
    name = name_of(element, "joint")
    where = f"joint {name!r}"
    kind = _kind(element, where)
    if element.find("mimic") is not None:
        raise ModelError(f"{where}: <mimic> joints are not supported; make it fixed or independent")
    parent, child = (_link(element, end, links, where) for end in ("parent", "child"))
    origin = placement_of(element, where)
    if kind == "fixed":
        return UrdfJoint(name, kind, parent, child, origin, (1.0, 0.0, 0.0), 0.0, 0.0, 0.0)
    return UrdfJoint(name, kind, parent, child, origin, _axis(element, where), *_limits(element, where))


def _kind(element: ET.Element, where: str) -> JointKind:
    kind = element.get("type", "")
    if kind in _KINDS:
        return _KINDS[kind]
    hint = "expected revolute, prismatic or fixed"
    if kind == "continuous":
        hint = "make it revolute with finite limits"
    raise ModelError(f"{where}: type {kind!r} is not supported; {hint}")


def _link(element: ET.Element, end: str, links: Sequence[str], where: str) -> str:
    found = element.find(end)
    link = None if found is None else found.get("link")
    if link is None:
        raise ModelError(f"{where}: lacks <{end} link=…/>")
    if link not in links:
        raise ModelError(f"{where}: its {end} link {link!r} does not exist")
    return link


def _axis(element: ET.Element, where: str) -> tuple[float, float, float]:
    found = element.find("axis")
    x, y, z = (1.0, 0.0, 0.0) if found is None else numbers(found, "xyz", 3, where, "1 0 0")
    norm = math.hypot(x, y, z)
    if norm < 1e-9:
        raise ModelError(f"{where}: its axis is zero; expected a direction")
    return x / norm, y / norm, z / norm


def _limits(element: ET.Element, where: str) -> tuple[float, float, float, float, float]:
    """Return lower, upper, velocity, acceleration and deceleration."""
    limit = element.find("limit")
    if limit is None:
        raise ModelError(f"{where}: lacks <limit lower=… upper=… velocity=…/>")
    lower, upper, velocity = (
        numbers(limit, attribute, 1, where)[0] for attribute in ("lower", "upper", "velocity")
    )
    if lower >= upper:
        raise ModelError(f"{where}: lower limit {lower:g} is not below the upper limit {upper:g}")
    if velocity <= 0.0:
        raise ModelError(f"{where}: velocity limit {velocity:g}; expected more than 0")
    return lower, upper, velocity, *_accelerations(limit, where)


def _accelerations(limit: ET.Element, where: str) -> tuple[float, float]:
    """Return acceleration and deceleration: deceleration defaults to acceleration, which defaults to inf."""
    found = []
    for attribute in ("acceleration", "deceleration"):
        if attribute in limit.attrib:
            (value,) = numbers(limit, attribute, 1, where)
            if value <= 0.0:
                raise ModelError(f"{where}: {attribute} limit {value:g}; expected more than 0")
            found.append(value)
        else:
            found.append(found[0] if found else math.inf)
    return found[0], found[1]
