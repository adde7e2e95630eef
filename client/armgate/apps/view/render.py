"""Rendering without a screen or a GPU: OpenGL through EGL, with one small shader.

A renderer belongs to the thread that made it.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from armgate.apps.errors import AppError
from armgate.apps.view import colours
from armgate.apps.view.camera_model import CameraModel
from armgate.apps.view.scene import Piece, Scene
from armgate.cell.placement import Placement

Picture = NDArray[np.uint8]
Links = Mapping[str, Mapping[str, Placement]]

MISSING = (
    "no camera picture, EGL cannot be used ({error}); "
    "on Debian or Ubuntu: apt-get install libegl1 libgl1-mesa-dri"
)

_VERTEX = """
#version 330
uniform mat4 clip;
uniform mat4 place;
in vec3 position;
in vec3 normal;
out vec3 at;
out vec3 across;
void main() {
    vec4 world = place * vec4(position, 1.0);
    at = world.xyz;
    across = mat3(place) * normal;
    gl_Position = clip * world;
}
"""
# Hemisphere light, a lamp at the camera and a sun; the floor gets a grid of 0.5 m, its lines a pixel wide.
_FRAGMENT = """
#version 330
uniform vec3 colour;
uniform vec3 eye;
uniform bool grid;
uniform vec3 background;
in vec3 at;
in vec3 across;
out vec4 seen;
void main() {
    vec3 n = normalize(across);
    vec3 to_eye = eye - at;
    vec3 v = normalize(to_eye);
    vec3 sun = normalize(vec3(-0.35, 0.45, 0.9));
    float sky = 0.5 + 0.5 * n.z;
    float light = 0.30 + 0.28 * sky + 0.40 * max(dot(n, sun), 0.0) + 0.14 * max(dot(n, v), 0.0);
    float shine = 0.22 * pow(max(dot(n, normalize(sun + v)), 0.0), 40.0);
    vec3 base = colour;
    if (grid && n.z > 0.9) {
        vec2 cell = at.xy / 0.5;
        vec2 line = abs(fract(cell - 0.5) - 0.5) / fwidth(cell);
        base *= 0.8 + 0.2 * clamp(min(line.x, line.y), 0.0, 1.0);
    }
    vec3 lit = base * light + shine;
    seen = vec4(mix(lit, background, 0.35 * smoothstep(3.0, 12.0, length(to_eye))), 1.0);
}
"""


class Renderer:
    """Renderer of a scene for one camera.

    Args:
        scene: The scene.
        camera_model: Model of the camera.

    Raises:
        AppError: EGL or OpenGL is not available; the text names the packages to install.
    """

    def __init__(self, scene: Scene, camera_model: CameraModel) -> None:
        self._context = _context()
        self.camera_model = camera_model
        size = (camera_model.width, camera_model.height)
        self._program = self._context.program(vertex_shader=_VERTEX, fragment_shader=_FRAGMENT)
        # No multisampling: in software it costs four times as much, and the page shows the pictures smaller.
        self._frame = self._context.framebuffer(
            self._context.renderbuffer(size), self._context.depth_renderbuffer(size)
        )
        self._context.enable(self._context.DEPTH_TEST)
        self._program["background"] = _unit(colours.BACKGROUND)
        self._standing = [self._shape(piece) for piece in scene.surroundings]
        self._moving = {
            (robot.name, link): [self._shape(piece) for piece in pieces]
            for robot in scene.robots
            for link, pieces in robot.pieces.items()
        }

    def picture(self, camera: Placement, links: Links) -> Picture:
        """Return the picture (height, width, 3) of a camera, with the robots' links at these poses."""
        view = self.camera_model.view(camera)
        self._program["clip"].write(_columns(self.camera_model.projection() @ view))
        self._program["eye"] = tuple(camera.t.tolist())
        self._frame.use()
        self._frame.clear(*_unit(colours.BACKGROUND), depth=1.0)
        self._draw(self._standing, Placement.identity())
        for (robot, link), shapes in self._moving.items():
            self._draw(shapes, links[robot][link])
        data = np.frombuffer(self._frame.read(components=3, alignment=1), dtype=np.uint8)
        return data.reshape(self.camera_model.height, self.camera_model.width, 3)[::-1].copy()

    def close(self) -> None:
        """Release the resources of the context."""
        self._context.release()

    def _shape(self, piece: Piece) -> tuple[colours.RGB, Any]:
        mesh = piece.mesh
        corners = np.concatenate([mesh.vertices, mesh.normals], axis=1).astype("f4")
        buffer = self._context.buffer(corners.tobytes())
        index = self._context.buffer(mesh.faces.astype("i4").tobytes())
        array = self._context.vertex_array(self._program, [(buffer, "3f 3f", "position", "normal")], index)
        return piece.colour, array

    def _draw(self, shapes: list[tuple[colours.RGB, Any]], place: Placement) -> None:
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = place.R, place.t
        self._program["place"].write(_columns(matrix))
        for colour, array in shapes:
            self._program["colour"] = _unit(colour)
            self._program["grid"] = colour == colours.FLOOR
            array.render()


def _context() -> Any:
    import moderngl

    try:
        return moderngl.create_context(standalone=True, backend="egl", require=330)
    except Exception as error:  # drivers raise exceptions of many kinds
        raise AppError(MISSING.format(error=str(error).strip() or type(error).__name__)) from error


def _unit(colour: colours.RGB) -> tuple[float, float, float]:
    r, g, b = (value / 255.0 for value in colour)
    return r, g, b


def _columns(matrix: NDArray[np.float64]) -> bytes:
    return matrix.T.astype("f4").tobytes()
