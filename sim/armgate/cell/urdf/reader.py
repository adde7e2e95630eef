"""Reading of a ``<robot>`` element: its links, joints and bodies, which must form one tree."""

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from armgate.cell.errors import ModelError
from armgate.cell.urdf.bodies import check_body_name, collisions, read_body
from armgate.cell.urdf.description import Urdf, UrdfBody, UrdfJoint
from armgate.cell.urdf.elements import name_of, unique
from armgate.cell.urdf.joints import read_joint
from armgate.cell.urdf.vocabulary import VERSIONS, unknown_words
from armgate.cell.urdf.xml_tree import line_prefix, parse_xml

MAX_LINKS = 256
"""Largest number of links, and of joints: the protocol describes no more."""

MAX_BODIES = 4096
"""Largest number of bodies: the protocol describes no more."""


class _ElementErrors:
    """Errors of one description, raised together."""

    def __init__(self, texts: Iterable[str]) -> None:
        self.texts = list(texts)

    @contextmanager
    def collecting(self, element: ET.Element) -> Iterator[None]:
        """Catch and keep a ModelError about an element."""
        try:
            yield
        except ModelError as error:
            self.texts.append(f"{line_prefix(element)}{error}")

    def check(self) -> None:
        """Raise all errors as one ModelError, a line each."""
        if self.texts:
            raise ModelError("\n".join(dict.fromkeys(self.texts)))


def read_urdf(text: str) -> Urdf:
    """Read a URDF text, see ``read_robot``."""
    return read_robot(parse_xml(text))


def read_robot(root: ET.Element, meshes: bool = False) -> Urdf:
    """Read a ``<robot>`` element.

    Args:
        root: The element.
        meshes: If true, accept ``<mesh>`` and leave its bodies out.

    Raises:
        ModelError: It is malformed or contains something that is not supported; a line for each error, with
            the line of the file and the name of the element.
    """
    errors = _ElementErrors(unknown_words(root))
    with errors.collecting(root):
        _check_version(root)
    links, joints, bodies = (
        _links(root, errors),
        _joints(root, errors),
        _bodies(root, meshes, errors),
    )
    errors.check()
    return Urdf(root.get("name", ""), _root_link(links, joints), links, joints, bodies)


def check_counts(root: ET.Element) -> None:
    """Raise a ModelError if a description is so large that reading it would take minutes."""
    for tag, most in (("link", MAX_LINKS), ("joint", MAX_LINKS), ("link/collision", MAX_BODIES)):
        count = len(root.findall(tag))
        if count > most:
            what = tag.rpartition("/")[2]
            raise ModelError(f"{count} elements <{what}>; expected at most {most}: simplify the description")


def _check_version(root: ET.Element) -> None:
    version = root.get("version", VERSIONS[0])
    if version not in VERSIONS:
        raise ModelError(f"version {version!r} of URDF is not known; expected one of {', '.join(VERSIONS)}")
    rotated = [
        *root.iterfind("joint/origin[@quat_xyzw]"), *root.iterfind("link/collision/origin[@quat_xyzw]"),
    ]  # fmt: skip
    if rotated and version == VERSIONS[0]:
        at = getattr(rotated[0], "line", None)
        where = "" if at is None else f" (line {at})"
        raise ModelError(
            f'quat_xyzw needs <robot version="1.1">{where}: other programs ignore it in this file'
        )


def _links(root: ET.Element, errors: _ElementErrors) -> tuple[str, ...]:
    names: list[str] = []
    for element in root.findall("link"):
        with errors.collecting(element):
            names.append(unique(name_of(element, "link"), "link", names))
    return tuple(names)


def _joints(root: ET.Element, errors: _ElementErrors) -> tuple[UrdfJoint, ...]:
    links = [element.get("name", "") for element in root.findall("link")]
    names: list[str] = []
    joints = []
    for element in root.findall("joint"):
        with errors.collecting(element):
            names.append(unique(name_of(element, "joint"), "joint", names))
            joints.append(read_joint(element, links))
    return tuple(joints)


def _bodies(root: ET.Element, meshes: bool, errors: _ElementErrors) -> tuple[UrdfBody, ...]:
    names: dict[str, bool] = {}
    bodies = []
    for link in root.findall("link"):
        for name, element in collisions(link):
            with errors.collecting(element):
                check_body_name(link.get("name", ""), name, names)
                if not (meshes and element.find("geometry/mesh") is not None):
                    bodies.append(read_body(link.get("name", ""), name, element))
    return tuple(bodies)


def _root_link(links: tuple[str, ...], joints: tuple[UrdfJoint, ...]) -> str:
    if not links:
        raise ModelError("there is no <link>; expected at least one")
    children: list[str] = []
    for joint in joints:
        children.append(unique(joint.child, "child link", children))
    roots = [link for link in links if link not in children]
    if not roots:
        raise ModelError("every link is the child of a joint: the joints form a loop; expected a tree")
    if len(roots) > 1:
        raise ModelError(f"links {', '.join(roots)} have no parent; expected exactly one root link")
    _refuse_loops(roots[0], links, joints)
    return roots[0]


def _refuse_loops(root: str, links: tuple[str, ...], joints: tuple[UrdfJoint, ...]) -> None:
    reached, front = {root}, [root]
    while front:
        link = front.pop()
        children = [joint.child for joint in joints if joint.parent == link]
        reached.update(children)
        front.extend(children)
    lost = [link for link in links if link not in reached]
    if lost:
        raise ModelError(f"links {', '.join(lost)} are not connected to {root}: their joints form a loop")
