"""Nodes of the page's scene: a frame for each link with its meshes, moved by armgate's own kinematics."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from armgate.apps.view import colours
from armgate.apps.view.scene import Piece, Scene
from armgate.cell.placement import Placement
from armgate.client import Description

MOVED = 1e-5
"""Smallest change of a pose that is sent, m and unit of rotation."""


class LinkNodes:
    """Nodes of one robot's links under ``root``; only changes are sent.

    Args:
        page: Scene of the page.
        root: Path of the node in the scene.
        pieces: Meshes of the robot, by link.
        ghost: Colour if the robot is drawn as a translucent shape; otherwise None.
    """

    def __init__(
        self, page: Any, root: str, pieces: Mapping[str, tuple[Piece, ...]], ghost: colours.RGB | None = None
    ) -> None:
        self._frames = {link: page.add_frame(f"{root}/{link}", show_axes=False) for link in pieces}
        self._shown: dict[str, Placement] = {}
        self._visible = True
        for link, own in pieces.items():
            for number, piece in enumerate(own):
                add_piece(page, f"{root}/{link}/{number}", piece, ghost)

    def move(self, places: Mapping[str, Placement]) -> None:
        """Move the links."""
        for link, place in places.items():
            before = self._shown.get(link)
            if before is None or moved(before, place):
                self._shown[link] = place
                frame = self._frames[link]
                frame.position = place.t
                frame.wxyz = wxyz(place)

    def show(self, visible: bool) -> None:
        """Show or hide the robot."""
        if visible != self._visible:
            self._visible = visible
            for frame in self._frames.values():
                frame.visible = visible


def add_piece(page: Any, name: str, piece: Piece, ghost: colours.RGB | None = None) -> None:
    """Add a mesh, and its edges unless it is a ghost."""
    mesh = piece.mesh
    page.add_mesh_simple(
        name,
        mesh.vertices,
        mesh.faces,
        color=ghost or piece.colour,
        opacity=0.22 if ghost else None,
        flat_shading=False,
        side="double" if ghost else "front",
        cast_shadow=ghost is None,
        receive_shadow=ghost is None,
    )
    if len(mesh.edges) and ghost is None:
        page.add_line_segments(
            f"{name}/edges", mesh.edges, colors=colours.EDGE, thickness=1.0, thickness_units="screen"
        )


def draw_surroundings(page: Any, scene: Scene) -> None:
    """Draw the surroundings, the grid on the floor and the light, once."""
    page.set_up_direction("+z")
    _light(page)
    page.set_background_image(_plain())
    for number, piece in enumerate(scene.surroundings):
        add_piece(page, f"/surroundings/{number}", piece)
    floor = floor_of(scene.description)
    if floor is not None:
        x, y, z, width, depth = floor
        page.add_grid(
            "/grid", width, depth, position=(x, y, z + 0.002), cell_size=0.5, section_size=1.0,
            cell_color=(140, 146, 154), section_color=(112, 118, 128), shadow_opacity=0.0, fade_strength=0.0,
        )  # fmt: skip


def _light(page: Any) -> None:
    """Add light from above and a sun; without shadows, which are slow in software rendering."""
    page.configure_default_lights(enabled=False)
    page.configure_environment_map(None)
    page.add_light_hemisphere(
        "/light/sky", sky_color=(255, 255, 255), ground_color=(150, 150, 160), intensity=1.6
    )
    page.add_light_directional("/light/sun", intensity=1.7, position=(-3.0, -4.0, 8.0))
    page.add_light_directional("/light/fill", intensity=0.5, position=(4.0, 5.0, 3.0))


def floor_of(description: Description) -> tuple[float, float, float, float, float] | None:
    """Return centre and height of the floor's top, its width and depth, m; None without a level floor."""
    for body in description.bodies:
        if (
            body.robot is None
            and body.name == "floor"
            and body.shape.kind == "box"
            and not any(body.xyzw[:3])
        ):
            x, y, z = body.xyz
            width, depth, thick = body.shape.size
            return x, y, z + thick / 2, width, depth
    return None


def wxyz(place: Placement) -> tuple[float, float, float, float]:
    """Return the rotation as a quaternion (w, x, y, z)."""
    x, y, z, w = place.xyzw()
    return w, x, y, z


def _plain() -> Any:
    return np.full((2, 2, 3), colours.BACKGROUND, dtype=np.uint8)


def moved(before: Placement, now: Placement) -> bool:
    """Return True if the difference of two poses is visible."""
    return bool(np.abs(before.t - now.t).max() > MOVED or np.abs(before.R - now.R).max() > MOVED)
