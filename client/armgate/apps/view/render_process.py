"""Process that draws the camera's pictures.

OpenGL without a GPU computes for some hundredths of a second and blocks all other threads of its process
meanwhile. The threads that drive robots and update the page must not wait for it.
"""

import multiprocessing
import signal
from multiprocessing.connection import Connection

from armgate.apps.errors import AppError
from armgate.apps.view.camera_model import CameraModel
from armgate.apps.view.render import Links, Picture, Renderer
from armgate.apps.view.scene import Scene
from armgate.cell.placement import Placement


class RenderProcess:
    """Renderer in a process of its own; to be used by one thread.

    Args:
        scene: The scene.
        camera_model: Model of the camera.

    Raises:
        AppError: OpenGL is not available; the text names the packages to install.
    """

    def __init__(self, scene: Scene, camera_model: CameraModel) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_paint, args=(theirs, scene, camera_model), name="camera", daemon=True
        )
        self._process.start()
        theirs.close()
        self._answer()

    def picture(self, camera: Placement, links: Links) -> Picture:
        """Return the picture (height, width, 3) of a camera, with the robots' links at these poses.

        Raises:
            AppError: The process has ended.
        """
        try:
            self._pipe.send((camera, links))
        except OSError as error:
            raise AppError("no camera picture any more: the process that draws it has ended") from error
        picture = self._answer()
        assert picture is not None
        return picture

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.join(1.0)
        self._process.kill()
        self._process.join()

    def _answer(self) -> Picture | None:
        try:
            answer: Picture | str | None = self._pipe.recv()
        except (EOFError, OSError) as error:
            raise AppError("no camera picture any more: the process that draws it has ended") from error
        if isinstance(answer, str):
            raise AppError(answer)
        return answer


def _paint(pipe: Connection, scene: Scene, camera_model: CameraModel) -> None:
    """Draw pictures until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the viewer ends it
    try:
        renderer = Renderer(scene, camera_model)
    except (AppError, ModuleNotFoundError) as error:
        pipe.send(str(error))
        return
    pipe.send(None)
    try:
        while True:
            pipe.send(renderer.picture(*pipe.recv()))
    except (EOFError, OSError):
        return
    finally:
        renderer.close()
