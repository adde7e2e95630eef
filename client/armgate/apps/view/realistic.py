"""Real meshes of known arms, from the optional extra ``meshes``; without it nothing, and no error."""

from armgate.apps.view import looks
from armgate.apps.view.shapes import Mesh

Found = dict[str, list[tuple[looks.RGB | None, Mesh]]]


def real_meshes(urdf: str) -> Found:
    """By link: colour (None for that of an arm of primitives) and mesh."""
    return {}
