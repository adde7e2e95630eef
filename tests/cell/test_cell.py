import shutil

import numpy as np
import pytest

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.cell.errors import ConfigError, ModelError


def named(cell):
    return {(cell.bodies[p.a].name, cell.bodies[p.b].name): p for p in cell.pairs}


def built(configs, tmp_path, overlay, base="demo.yaml"):
    path = tmp_path / "overlay.yaml"
    path.write_text(overlay)
    return build_cell(load_config([configs / base, path]))


def test_robots_keep_the_order_of_the_configuration(demo):
    assert [robot.name for robot in demo.robots] == ["FR", "GR"]
    assert demo.robot_index("GR") == 1
    assert demo.robot("FR") is demo.robots[0]
    with pytest.raises(ModelError, match="there is no robot 'XR' in cell 'demo'; expected one of FR, GR"):
        demo.robot("XR")


def test_bodies_are_the_robots_then_the_surroundings(demo):
    for body in demo.bodies:
        if body.robot is None:
            assert demo.surroundings[body.index] is body
        else:
            robot = demo.robots[body.robot]
            assert body.name == f"{robot.name}/{robot.model.bodies[body.index].name}"
    robots = [body.robot for body in demo.bodies]
    assert robots == sorted(r for r in robots if r is not None) + [None] * len(demo.surroundings)


def test_default_accelerations_reach_full_speed_in_a_quarter_second(demo):
    for robot in demo.robots:
        assert robot.acceleration == pytest.approx(robot.velocity / 0.25)
        assert robot.deceleration == pytest.approx(robot.velocity / 0.25)


@pytest.mark.parametrize(
    ("own", "first", "difference"),
    [
        ("", 0.03, 0.0),
        ("link: {kind: emulated, lags: {A1: 33 ms, A3: 28 ms}}", 0.033, 0.005),
        ("link: {kind: emulated, lag: 0.01, lags: {A1: 33 ms}}", 0.033, 0.023),
        ("lag_difference: 2 ms", 0.03, 0.002),
        ("lag_difference: 0, link: {kind: emulated, lags: {A1: 33 ms}}", 0.033, 0.0),
    ],
)
def test_the_lag_difference_of_an_emulated_robot_is_that_of_its_joints_unless_declared(
    configs, tmp_path, own, first, difference
):
    robot = built(configs, tmp_path, f"robots: {{FR: {{{own}}}}}").robots[0]
    assert robot.lags[0] == first
    assert robot.lag_difference == pytest.approx(difference, abs=1e-12)


def test_the_lag_difference_of_a_real_robot_is_ten_percent_unless_declared(configs, tmp_path):
    link = configs / "links" / "rsi-example.yaml"
    robot = build_cell(load_config([configs / "demo.yaml", link])).robots[0]
    assert (set(robot.lags), robot.lag_difference) == ({0.03}, 0.003)
    overlay = tmp_path / "over.yaml"
    overlay.write_text("robots: {FR: {lag_difference: null, link: {lag: 60 ms}}}")
    robot = build_cell(load_config([configs / "demo.yaml", link, overlay])).robots[0]
    assert robot.lag_difference == pytest.approx(0.006)


def test_a_lag_of_an_unknown_joint_is_refused(configs, tmp_path):
    with pytest.raises(ConfigError, match=r"robots.FR.link.lags.B1: robot FR has no joint 'B1'"):
        built(configs, tmp_path, "robots: {FR: {link: {kind: emulated, lags: {B1: 0.03}}}}")


def test_configured_bounds_replace_those_of_the_urdf(configs, tmp_path):
    overlay = """
robots:
  P:
    start: [200 deg, 0, 0]
    joints:
      J1: {lower: -90 deg, upper: 1.0, velocity: 1.0, acceleration: 90 deg/s2, deceleration: null}
      J2: {velocity: 1.0, deceleration: 5}
"""
    robot = built(configs, tmp_path, overlay, "planar.yaml").robots[0]
    assert robot.lower == pytest.approx([-np.pi / 2, -2.6, -2.6])
    assert robot.upper == pytest.approx([1.0, 2.6, 2.6])
    assert robot.velocity == pytest.approx([1.0, 1.0, 3.0])
    assert robot.acceleration == pytest.approx([np.pi / 2, 4.0, 12.0])
    assert robot.deceleration.tolist() == [np.inf, 5.0, 12.0]
    assert robot.start[0] > robot.upper[0]  # outside its limits, where only retreat is admitted


def test_arrays_are_read_only(demo):
    robot = demo.robots[0]
    for array in (
        robot.lower,
        robot.upper,
        robot.velocity,
        robot.acceleration,
        robot.deceleration,
        robot.start,
    ):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


# --- pairs ------------------------------------------------------------------------------------------------


def test_pairs_on_one_joint_or_neighbouring_joints_are_left_out(planar):
    assert [pair for pair in named(planar) if pair[0].startswith("P/") and pair[1].startswith("P/")] == [
        ("P/base_link", "P/link_2"),
        ("P/base_link", "P/link_3"),
        ("P/link_1", "P/link_3"),
    ]


def test_pairs_of_fixed_bodies_are_left_out(demo):
    pairs = named(demo)
    assert ("FR/base_link", "floor") not in pairs
    assert ("GR/gantry_post_left_front", "floor") not in pairs
    assert ("FR/base_link", "GR/gantry_post_left_front") not in pairs


def test_fixed_bodies_form_pairs_with_moving_bodies_of_other_robots(demo):
    pairs = named(demo)
    assert pairs["FR/link_4", "GR/gantry_post_left_front"].kind == "robots"
    assert pairs["FR/base_link", "GR/link_6"].limit == demo.config.stop_distance
    assert pairs["GR/link_6", "floor"].kind == "surroundings"


def test_the_limit_of_a_pair_depends_on_its_kind(demo):
    for pair in demo.pairs:
        expected = demo.config.self_distance if pair.kind == "self" else demo.config.stop_distance
        assert pair.limit == expected


def test_the_first_body_of_a_pair_is_of_the_first_robot_or_nearer_to_the_base(demo):
    for pair in demo.pairs:
        a, b = demo.bodies[pair.a], demo.bodies[pair.b]
        assert a.robot is not None
        if pair.kind == "self":
            bodies = demo.robots[a.robot].model.bodies
            assert a.robot == b.robot
            assert bodies[a.index].joint < bodies[b.index].joint
        elif pair.kind == "robots":
            assert a.robot < b.robot
        else:
            assert b.robot is None


def test_every_pair_occurs_once(demo):
    assert len({frozenset((pair.a, pair.b)) for pair in demo.pairs}) == len(demo.pairs)


def test_pairs_can_be_ignored_by_link_or_body(configs, tmp_path, planar):
    cell = built(configs, tmp_path, "robots: {P: {ignore_pairs: [[link_3, base_link]]}}\n", "planar.yaml")
    assert set(named(planar)) - set(named(cell)) == {("P/base_link", "P/link_3")}
    overlay = """
robots:
  P:
    bodies: {tip: {link: tool0, shape: {sphere: 20 mm}}}
    ignore_pairs: [[tip, link_1]]
"""
    cell = built(configs, tmp_path, overlay, "planar.yaml")
    assert ("P/link_1", "P/tip") not in named(cell)
    assert ("P/base_link", "P/tip") in named(cell)


def test_the_second_of_an_ignored_pair_may_be_in_the_surroundings(configs, tmp_path, demo):
    cell = built(configs, tmp_path, "robots: {GR: {ignore_pairs: [[link_3, tank]]}}\n", "demo.yaml")
    assert ("GR/link_3", "tank") in named(demo)
    assert ("GR/link_3", "tank") not in named(cell)
    with pytest.raises(ConfigError, match="called 'tank'"):
        built(configs, tmp_path, "robots: {GR: {ignore_pairs: [[tank, link_3]]}}\n", "demo.yaml")


def test_the_ignored_pairs_of_the_demo_keep_their_distance(demo):
    # Ignored pairs cannot come nearer. The centre of the second body is fixed in the frame of the first body
    # (the wrist only turns about its own axis), or it slides along the length of both, or the height of the
    # first body above the floor is constant.
    rng = np.random.default_rng(4)
    for robot in demo.robots:
        names = [body.name for body in robot.model.bodies]
        for first, second in robot.config.ignore_pairs:
            a, b = names.index(first), names.index(second) if second in names else None
            gaps = []
            for _ in range(50):
                R, t = robot.model.body_placements(rng.uniform(robot.lower, robot.upper))
                apart = t[a][2:] if b is None else R[a].T @ (t[b] - t[a])
                gaps.append(apart[:1] if first == "gantry_bridge" else apart)
                if b is None:
                    gaps[-1] = np.array([*apart, R[a][2, 2]])
            assert np.ptp(np.array(gaps), axis=0).max() < 1e-9


# --- hash -------------------------------------------------------------------------------------------------


def test_the_hash_does_not_depend_on_the_paths_of_the_files(configs, tmp_path, demo):
    shutil.copytree(configs, tmp_path / "elsewhere")
    (tmp_path / "elsewhere/robots").rename(tmp_path / "elsewhere/arms")
    path = tmp_path / "elsewhere/demo.yaml"
    path.write_text("# a comment\n" + path.read_text().replace("robots/kr16.urdf", "arms/kr16.urdf"))
    assert build_cell(load_config([path])).hash == demo.hash


def test_the_hash_does_not_depend_on_units_or_the_server(configs, tmp_path, demo):
    assert built(configs, tmp_path, "stop_distance: 50 mm\nserver: {port: 0}\n").hash == demo.hash


@pytest.mark.parametrize(
    "overlay",
    [
        "stop_distance: 51 mm\n",
        "robots: {FR: {period: 4 ms}}\n",
        "robots: {FR: {joints: {A1: {velocity: 1}}}}\n",
        "robots: {FR: {base: {xyz: [0, 0, 0.001]}}}\n",
        "robots: {FR: {link: {lag: 0.0}}}\n",
        "robots: {GR: {gantry: {column: 0.21}}}\n",
        "robots: {GR: {start: [2.93, 0.0, 2.48, 0, -90 deg, 90 deg, 0, -90 deg, 1 deg]}}\n",
        "surroundings: {extra: {shape: {sphere: 0.1}, xyz: [5, 0, 0]}}\n",
        "clock: {kind: lockstep, participants: [a]}\n",
    ],
)
def test_the_hash_changes_with_the_cell(configs, tmp_path, demo, overlay):
    assert built(configs, tmp_path, overlay).hash != demo.hash


def test_a_cell_can_have_more_than_two_robots(configs, tmp_path):
    overlay = f"""
robots:
  Q: {{urdf: {configs}/robots/planar3.urdf, base: {{xyz: [3, 0, 0.5]}}, start: [0, 0, 0]}}
  R: {{urdf: {configs}/robots/planar3.urdf, base: {{xyz: [6, 0, 0.5]}}, start: [0, 0, 0]}}
"""
    cell = built(configs, tmp_path, overlay, "planar.yaml")
    assert [robot.name for robot in cell.robots] == ["P", "Q", "R"]
    assert ("Q/link_1", "R/base_link") in named(cell)
