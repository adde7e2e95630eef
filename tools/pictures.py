"""Pictures of README and documents: the viewer, still and in motion, and the four experiments in motion.

    python -m tools.pictures docs [viewer.png] [viewer.webp] [experiments.webp]

The experiments run through the whole stack in lock-step, one run each, and are drawn from their recordings
by the renderer of the viewer's camera picture. The pictures of the viewer are of a real page, in Chromium
without a screen: the still one while leader and follower of the demo work, the moving one of their recording.
"""

import io
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from time import sleep
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from armgate.apps.default_files import default_file
from armgate.apps.stack.fork_server import ForkServer
from armgate.apps.view.camera_model import CameraModel
from armgate.apps.view.overlays import q_of
from armgate.apps.view.render_process import RenderProcess
from armgate.apps.view.scene import Poses, Scene
from armgate.cell.placement import Placement
from armgate.client import State, connect
from armgate.experiment.experiment_file import load_experiment
from armgate.experiment.scene import build_scene
from armgate.experiment.trial_run import play
from armgate.experiment.trials import Trial, trials
from armgate.recording import Recording, StateSeries

Array = NDArray[np.float64]

WIDTH, HEIGHT, FINE = 640, 360, 2
"""Size of the experiments' animation in pixels; it is drawn FINE times as large."""
RATE = 10
"""Pictures per s of that animation."""
EYE, AT = (0.9, -3.5, 2.2), (1.35, 0.0, 1.15)
"""Place of its camera and point that the camera looks at, m."""
WINDOW = (1400, 900)
"""Size of the viewer's page, pixels."""
WORK = 9.0
"""Time for which the follower works before the page is photographed, s."""
FILM, SMALL = 64, (980, 630)
"""Number of pictures of the page in motion, and their size in pixels."""
FILM_BEGIN, FILM_STEP, FILM_SHOWN = 0.5, 0.4, 120
"""Time of the first picture in the run, time between two pictures [s], and display time of each [ms]."""
SETTLE = 1.5
"""Time for the page to draw the state at another time of a recording, s."""
_SEEK = """time => {
    const label = [...document.querySelectorAll('label')].find(each => each.textContent === 'Time [s]');
    const input = label.closest('.mantine-Flex-root').querySelector('input[inputmode]');
    const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, 'value').set;
    set.call(input, time);
    input.dispatchEvent(new Event('input', {bubbles: true}));
}"""
"""Script that enters a time into the field beside the time slider."""


class Clip(NamedTuple):
    """Part of one run, from begin to end [s], and the factor by which it is shown faster."""

    experiment: str
    case: str
    seed: int
    begin: float
    end: float
    faster: float
    title: str


CLIPS = (
    Clip("approach", "approach", 0, 0.0, 3.5, 1.0, "Approach: the camera turns to the leader's tool"),
    Clip("tracking", "fast-predicted", 0, 0.5, 6.0, 1.0, "Tracking: the leader moves at 0.5 m/s"),
    Clip("zoom", "zoom", 0, 2.0, 18.0, 3.2, "Zoom: an operator changes the wanted distance"),
    Clip(
        "collision",
        "dash-0.25",
        4,
        1.0,
        11.0,
        2.0,
        "Collision: the leader dashes at the follower",
    ),
)


def main(folder: Path, *names: str) -> None:
    """Write the pictures into a folder, or only those with these names."""
    makers = {"experiments.webp": animation, "viewer.png": screenshot, "viewer.webp": film}
    for name in names or makers:
        makers[name](folder / name)


# --- the animation ----------------------------------------------------------------------------------------


def animation(file: Path) -> None:
    """Write the four experiments, one after the other."""
    frames: list[Image.Image] = []
    fork_server = ForkServer()
    fork_server.warm()
    with TemporaryDirectory() as runs:
        for clip in CLIPS:
            run = Path(runs) / clip.experiment
            play(
                _trial(clip),
                build_scene((default_file("demo.yaml"),)),
                run,
                fork_server,
                realtime=False,
                show=_quiet,
            )
            frames += list(_frames(clip, run))
            sys.stdout.write(f"{clip.experiment}: {len(frames)} pictures\n")
    frames[0].save(
        file, save_all=True, append_images=frames[1:], duration=1000 // RATE, loop=0, quality=45, method=4
    )
    sys.stdout.write(f"{file}: {file.stat().st_size / 1e6:.2f} MB\n")


def _trial(clip: Clip) -> Trial:
    setup = load_experiment(default_file(f"experiments/{clip.experiment}.yaml"))
    found = trials(setup, build_scene((default_file("demo.yaml"),)))
    case = [trial for trial in found if clip.case in trial.case]
    return case[min(clip.seed, len(case) - 1)]


def _quiet(_watch: object) -> None:
    """Show nothing."""


def _frames(clip: Clip, run: Path) -> Iterator[Image.Image]:
    recording = Recording.open(run)
    series = StateSeries(recording)
    scene = Scene.build(series.description, recording.header.asset, meshes=False)
    poses = Poses(scene)
    robot = scene.camera_robot
    assert robot is not None
    assert robot.described.camera is not None
    # Two renderers of one process would draw into each other's pictures.
    outside = RenderProcess(scene, CameraModel(FINE * WIDTH, FINE * HEIGHT, float(np.radians(52.0))))
    inside = RenderProcess(scene, CameraModel(FINE * 192, FINE * 144))
    try:
        for time in np.arange(clip.begin, min(clip.end, series.end - series.start), clip.faster / RATE):
            state = series.at(series.start + time)
            if state is None or any(entry.q is None for entry in state.entries):
                continue
            q = {each.name: q_of(state, each.name) for each in scene.robots}
            links = {name: poses.links(name, place) for name, place in q.items()}
            lens = poses.models[robot.name].frame(q[robot.name], robot.described.camera)
            yield _composed(
                outside.picture(_looking(EYE, AT), links), inside.picture(lens, links), clip, state, time
            )
    finally:
        outside.close()
        inside.close()


def _looking(eye: tuple[float, float, float], at: tuple[float, float, float]) -> Placement:
    """Return the pose of a camera at one point that looks at another: z ahead, x up."""
    z = np.subtract(at, eye)
    z /= np.linalg.norm(z)
    right = np.cross(z, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return Placement(np.stack([np.cross(right, z), right, z], axis=1), np.array(eye))


def _composed(outside: Any, inside: Any, clip: Clip, state: State, time: float) -> Image.Image:
    picture = _small(outside)
    inset = _small(inside)
    draw = ImageDraw.Draw(picture, "RGBA")
    left, top = WIDTH - inset.width - 12, HEIGHT - inset.height - 12
    draw.rectangle((left - 2, top - 2, WIDTH - 11, HEIGHT - 11), fill=(255, 255, 255, 255))
    picture.paste(inset, (left, top))
    draw.text((left + 6, top + 4), "what the camera sees", font=_font(11), fill=(30, 34, 40))
    draw.rectangle((0, 0, WIDTH, 44), fill=(255, 255, 255, 170))
    draw.text((12, 5), clip.title, font=_font(15), fill=(20, 24, 30))
    faster = "" if clip.faster == 1.0 else f", {clip.faster:g} times faster"
    draw.text((12, 25), f"{time:4.1f} s{faster}   {_figures(state)}", font=_font(12), fill=(70, 76, 84))
    return picture


def _small(picture: Any) -> Image.Image:
    height, width = picture.shape[:2]
    image: Image.Image = Image.fromarray(picture)
    return image.resize((width // FINE, height // FINE), Image.Resampling.LANCZOS)


def _figures(state: State) -> str:
    parts = []
    if (angle := state.signals.get("follow.angle_error")) is not None:
        parts.append(f"angle error {np.degrees(angle.value[0]):.2f}°")
    if (distance := state.signals.get("follow.distance_error")) is not None:
        parts.append(f"distance error {1000 * distance.value[0]:+.0f} mm")
    near = [
        near.distance for entry in state.entries for near in entry.nearest or () if _of_two_robots(near.pair)
    ]
    if near:
        parts.append(f"clearance at least {1000 * min(near):.0f} mm")
    return "   ".join(parts)


def _of_two_robots(pair: tuple[str, str]) -> bool:
    a, b = (name.partition("/")[0] for name in pair)
    return a != b


def _font(size: int) -> Any:
    load: Any = ImageFont.load_default
    return load(size)


# --- the viewer's page ------------------------------------------------------------------------------------


def screenshot(file: Path) -> None:
    """Write a picture of the page of an operator who drives nothing, while leader and follower work."""
    demo, path = default_file("demo.yaml"), default_file("paths/inspection.csv")
    with ExitStack() as stack:
        address = stack.enter_context(_armgate("serve", demo, "--port", "0"))
        url = stack.enter_context(
            _armgate("view", address, "--port", "0", "--role", "operator", "--no-meshes")
        )
        tab = stack.enter_context(_page(url))
        stack.enter_context(_armgate("follow", address, "--robot", "FR", "--leader", "GR", wait=False))
        stack.enter_context(_armgate("lead", address, "--path", path, wait=False))
        _at_work(address)
        shot = _photograph(tab)
    shot.quantize(200, dither=Image.Dither.NONE).save(file, optimize=True)
    sys.stdout.write(f"{file}: {file.stat().st_size / 1e6:.2f} MB\n")


def film(file: Path) -> None:
    """Write the page in motion: it plays the recording of a demo in lock-step, one picture at a time."""
    with TemporaryDirectory() as folder, ExitStack() as stack:
        run = Path(folder) / "run"
        duration = FILM_BEGIN + FILM * FILM_STEP
        with _armgate("demo", "--lockstep", "--duration", duration, "--out", run, wait=False) as demo:
            demo.wait()
        url = stack.enter_context(_armgate("view", run, "--port", "0", "--no-meshes"))
        tab = stack.enter_context(_page(url))
        pictures = [*_pictures_of_page(tab)]
    pictures[0].save(
        file, save_all=True, append_images=pictures[1:], duration=FILM_SHOWN, loop=0, quality=60, method=6
    )
    sys.stdout.write(f"{file}: {file.stat().st_size / 1e6:.2f} MB\n")


def _pictures_of_page(tab: Any) -> Iterator[Image.Image]:
    """Yield the page of a recording at equal steps of time."""
    for number in range(FILM):
        tab.evaluate(_SEEK, f"{FILM_BEGIN + number * FILM_STEP:.2f}")
        sleep(SETTLE)
        yield _photograph(tab).resize(SMALL, Image.Resampling.LANCZOS)


@contextmanager
def _page(url: str) -> Iterator[Any]:
    """Open a page in a browser without a screen."""
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    with import_module("support.browsers").chromium() as browser:
        tab = browser.tab()
        tab.resize(*WINDOW)
        tab.open(url)
        sleep(8.0)
        # The note that there is no GPU is of no use to readers.
        tab.evaluate("document.querySelector('.mantine-Notification-closeButton')?.click()")
        yield tab


def _photograph(tab: Any) -> Image.Image:
    return Image.open(io.BytesIO(tab.screenshot())).convert("RGB")


def _at_work(address: str) -> None:
    """Wait until the follower has followed for some seconds."""
    with connect(address, name="pictures", role="observer") as cell:
        cell.subscribe(every=10)
        since = None
        for state in cell.states():
            if "follow.angle_error" in state.signals:
                since = since or state.time
                if state.time > since + WORK:
                    return


@contextmanager
def _armgate(*arguments: object, wait: bool = True) -> Iterator[Any]:
    """Run a command; yield the last word of its first line, or its process if nothing is waited for."""
    command = [sys.executable, "-m", "armgate.apps", *map(str, arguments)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)  # noqa: S603
    assert child.stdout is not None
    try:
        yield child.stdout.readline().split()[-1] if wait else child
    finally:
        child.terminate()
        child.wait(30)
        child.stdout.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), *sys.argv[2:])
