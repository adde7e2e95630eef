"""The camera's pictures, drawn in a process of their own.

OpenGL without a GPU computes for some hundredths of a second and lets no other thread of its process run
meanwhile: what steers robots and moves the page must not wait for it.
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
    """Draws a scene as a camera sees it; for one thread.

    Args:
        scene: What there is.
        camera_model: The camera.

    Raises:
        AppError: There is no OpenGL; names the packages.
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
        """The picture (height, width, 3) from a camera with the robots' links at these places.

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
        """Ends the process."""
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
    """What the process does until its pipe is closed."""
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
