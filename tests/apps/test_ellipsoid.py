"""Pictures of ellipsoids for planar and spatial robots, along each kind of motion."""

import math
import xml.etree.ElementTree as ET
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from armgate.apps.ellipsoid.command import ellipsoid
from armgate.apps.ellipsoid.motion import Motion, both_ways, motion_of, moving_rows
from armgate.apps.ellipsoid.picture import _Scene, draw
from armgate.apps.errors import UsageError
from armgate.apps.lead.path import format_path
from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import load_config
from armgate.control.redundancy.ellipsoids import velocity_ellipsoid
from armgate.control.redundancy.tasks import FrameTask

CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.fixture(scope="module")
def planar() -> Cell:
    return build_cell(load_config([CONFIGS / "planar.yaml"]))


@pytest.fixture(scope="module")
def demo() -> Cell:
    return build_cell(load_config([CONFIGS / "demo.yaml"]))


def path_file(folder: Path, q: np.ndarray, joints: str = "J1 J2 J3") -> Path:
    file = folder / "p.csv"
    file.write_text(format_path("P", [(name, "rad") for name in joints.split()], 0.012, q))
    return file


def test_the_rows_of_a_planar_arm_are_those_of_its_plane(planar: Cell, demo: Cell) -> None:
    assert moving_rows(planar.robots[0].model, "tool0") == ("x", "y")
    assert moving_rows(demo.robot("FR").model, "tool0") == ("x", "y", "z")


def test_a_self_motion_extends_from_joint_limit_to_joint_limit(planar: Cell) -> None:
    motion = motion_of(planar, None, None, None, self_motion=True)
    model, start = motion.model, np.array(planar.robots[0].start)
    place = model.frame(start, "tool0").t
    assert max(np.abs(model.frame(q, "tool0").t - place).max() for q in motion.q) < 1e-8
    assert min(np.abs(q - start).max() for q in motion.q) == 0.0
    assert max(np.linalg.norm(b - a) for a, b in pairwise(motion.q)) < 0.03
    stretch = both_ways(motion.task, np.array([0.3, 0.8, 2.0]))
    low, high = model.lower, model.upper
    for end in (stretch[0], stretch[-1]):
        assert np.minimum(end - low, high - end).min() < 0.03


def test_positions_are_evenly_spaced_and_a_closed_motion_does_not_repeat_its_start(
    planar: Cell, tmp_path: Path
) -> None:
    line = np.linspace([0.0, 0.1, 0.2], [1.0, 0.6, -0.4], 101) ** 1.0
    motion = motion_of(planar, "P", None, path_file(tmp_path, line), self_motion=False)
    picked = motion.pick(5)
    np.testing.assert_allclose(picked, np.linspace(line[0], line[-1], 5), atol=1e-8)
    closed = motion_of(planar, "P", None, None, self_motion=True).pick(6)
    assert len(closed) == 6
    assert np.linalg.norm(closed[0] - closed[-1]) > 0.5


def test_skeletons_lead_from_the_base_to_the_frame(planar: Cell, demo: Cell) -> None:
    motion = motion_of(planar, None, None, None, self_motion=False)
    line = motion.skeleton(np.zeros(3))
    np.testing.assert_allclose(line[:, 0], [0.0, 0.0, 0.5, 0.9, 1.2], atol=1e-12)
    gantry = motion_of(demo, "GR", None, None, self_motion=False)
    hung = gantry.skeleton(gantry.q[0])
    assert len(hung) == 8
    np.testing.assert_allclose(hung[0], demo.robot("GR").start[:3], atol=0.5)
    np.testing.assert_allclose(hung[-1], gantry.model.frame(gantry.q[0], "tool0").t)


@pytest.mark.daily(1)
@pytest.mark.parametrize("suffix", [".png", ".svg"])
@pytest.mark.parametrize("name", ["FR", "GR"])
def test_spatial_robots_are_drawn_in_three_views(demo: Cell, tmp_path: Path, suffix: str, name: str) -> None:
    file = tmp_path / f"p{suffix}"
    motion = motion_of(demo, name, None, None, self_motion=False)
    line = draw(motion, file, count=3, force=True)
    assert str(file) in line
    data = file.read_bytes()
    assert data.startswith(b"\x89PNG" if suffix == ".png" else b"<?xml")
    if suffix == ".svg":
        texts = "".join(ET.fromstring(data).itertext())
        assert "Matplotlib" in texts or data.count(b"<path") > 40


def test_drawing_twice_gives_the_same_picture(planar: Cell, tmp_path: Path) -> None:
    motion = motion_of(planar, None, None, None, self_motion=True)
    for name in ("a.svg", "b.svg"):
        draw(motion, tmp_path / name, count=4, force=False)
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_the_ellipse_is_drawn_at_the_frame(planar: Cell) -> None:
    from matplotlib.figure import Figure

    motion = motion_of(planar, None, None, None, self_motion=False)
    axes = Figure().subplots()
    scene = _Scene(motion, 1, True)
    scene.paint(axes, ("x", "y"))
    place = motion.model.frame(motion.q[0], "tool0").t[:2]
    lengths = velocity_ellipsoid(motion.task.jacobian(motion.q[0])).lengths
    outline = next(line for line in axes.lines if len(line.get_xdata()) > 100)
    reach = np.linalg.norm(np.stack(outline.get_data()).T - place, axis=1)
    assert reach.min() / reach.max() == pytest.approx(lengths[1] / lengths[0], rel=1e-2)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert [label.split(",")[0] for label in labels] == ["velocity", "force"]


def test_a_singular_position_is_drawn_with_a_clipped_force_ellipse(planar: Cell, tmp_path: Path) -> None:
    robot = planar.robots[0]
    q = np.linspace([0.0, 1.0, 1.0], [0.0, 0.0, 0.0], 20)
    motion = Motion("stretched", robot.model, "tool0", ("x", "y"), q)
    draw(motion, tmp_path / "p.png", count=5, force=True)
    assert all(math.isfinite(w) for w in _Scene(motion, 5, True).w)
    alone = Motion("stretched", robot.model, "tool0", ("x", "y"), q[-1:])
    assert "manipulability 0 to 0" in draw(alone, tmp_path / "q.png", count=1, force=True)


def test_the_command_draws_the_planar_arm_by_default(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ellipsoid(self_motion=True, count=3, out=tmp_path / "p.png")
    assert "P of planar, frame tool0, self-motion" in capsys.readouterr().out
    assert (tmp_path / "p.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"name": "XR"}, "no robot 'XR'; it has P"),
        ({"frame": "nose"}, "has no moving frame 'nose'; it has link_1"),
        ({"frame": "base_link"}, "has no moving frame 'base_link'"),
        ({"path": Path("p.csv"), "self_motion": True}, "exclude each other"),
    ],
)
def test_options_that_do_not_fit_the_cell_are_wrong_usage(
    planar: Cell, change: dict[str, object], text: str
) -> None:
    options = {"name": None, "frame": None, "path": None, "self_motion": False, **change}
    with pytest.raises(UsageError, match=text):
        motion_of(planar, **options)


def test_a_path_of_another_robot_is_wrong_use(planar: Cell, tmp_path: Path) -> None:
    file = path_file(tmp_path, np.zeros((2, 2)), "A B")
    with pytest.raises(UsageError, match="is for joints A B; P has J1 J2 J3"):
        motion_of(planar, None, None, file, self_motion=False)


def test_no_self_motion_and_no_picture_are_wrong_use(planar: Cell, tmp_path: Path) -> None:
    motion = motion_of(planar, None, None, None, self_motion=False)
    with pytest.raises(UsageError, match=r"\.png or \.svg"):
        draw(motion, tmp_path / "p.jpg", count=1, force=False)
    with pytest.raises(UsageError, match="cannot be written"):
        draw(motion, tmp_path / "none" / "p.png", count=1, force=False)
    task = FrameTask(motion.model, "tool0", ("x", "y", "rz"))
    with pytest.raises(UsageError, match="more joints than the 3 rows of the task"):
        both_ways(task, motion.q[0])
