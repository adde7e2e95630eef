import subprocess
import sys

import pytest
import yaml

from armgate.cell.cell import build_cell
from armgate.cell.config import CellConfig, LockstepClockConfig, dump_config, load_config
from armgate.cell.config.fields import ConfigModel
from armgate.cell.config.link_kinds import installed_kinds, load_kind
from armgate.cell.errors import ConfigError
from armgate.cell.shapes import Capsule, Sphere

CELL = """\
armgate: 1
name: small
robots:
  P:
    urdf: {urdf}
    start: [0 deg, 45 deg, 0.5]
    joints:
      J1: {{velocity: 90 deg/s, deceleration: null}}
surroundings:
  post: {{shape: {{capsule: [50 mm, 1 m]}}, xyz: [1, 1, 0]}}
"""


@pytest.fixture
def write(tmp_path, configs):
    def write(*changes, more="", name="cell.yaml"):
        text = CELL.format(urdf=configs / "robots/planar3.urdf")
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / name
        path.write_text(text + more)
        return path

    return write


def refused(path, build=False) -> ConfigError:
    if build:
        config = load_config([path])
        with pytest.raises(ConfigError) as caught:
            build_cell(config)
    else:
        with pytest.raises(ConfigError) as caught:
            load_config([path])
    assert str(caught.value).startswith(f"{path}:{caught.value.line}: {caught.value.path}: ")
    return caught.value


def test_a_configuration_is_read_with_defaults(write):
    config = load_config([write()])
    assert (config.stop_distance, config.self_distance, config.response) == (0.05, 0.02, "stop")
    assert (config.robots["P"].period, config.robots["P"].link.lag) == (0.012, 0.03)
    assert config.surroundings["post"].shape.shape == Capsule(0.05, 1.0)
    assert (config.clock.kind, config.server.port) == ("wall", 7411)


def test_a_sphere_needs_no_list(write):
    config = load_config([write(("capsule: [50 mm, 1 m]", "sphere: 20 cm"))])
    assert config.surroundings["post"].shape.shape == Sphere(0.2)


def test_an_overlay_changes_only_its_own_keys(write, tmp_path):
    overlay = tmp_path / "over.yaml"
    overlay.write_text(
        "robots: {P: {link: {kind: emulated, lag: 0.0}}}\nclock: {kind: lockstep, participants: [a]}\n"
    )
    config = load_config([write(), overlay])
    assert config.robots["P"].link.lag == 0.0
    assert config.robots["P"].start == load_config([write()]).robots["P"].start
    assert isinstance(config.clock, LockstepClockConfig)
    assert config.clock.grace == 10.0


def test_an_error_in_an_overlay_names_the_overlay(write, tmp_path):
    overlay = tmp_path / "over.yaml"
    overlay.write_text("armgate: 1\nrobots:\n  P:\n    period: -1\n")
    with pytest.raises(ConfigError) as caught:
        load_config([write(), overlay])
    assert str(caught.value) == f"{overlay}:4: robots.P.period: -1 is too small; expected more than 0"


@pytest.mark.parametrize(
    ("old", "new", "line", "path", "message"),
    [
        ("armgate: 1", "armgate: 2", 1, "armgate", "version 2 of the configuration is not known; expected 1"),
        ("armgate: 1", "armgate: true", 1, "armgate", "True is not a whole number"),
        ("armgate: 1", "armgate: '1'", 1, "armgate", "'1' is not a whole number"),
        ("name: small", "stop_distance: 3", 1, "name", "the key is missing"),
        ("name: small", "name: a b", 2, "name", "'a b' is not a valid name; expected 1 to 64 letters"),
        ("name: small", "name: 3", 2, "name", "3 is not a text"),
        ("name: small", "nam: small", 1, "name", "the key is missing"),
        ("    urdf", "    urfd", 4, "robots.P.urdf", "unknown key 'urfd'; did you mean 'urdf'?"),
        ("0.5]", "0.5 furlong]", 6, "robots.P.start.2", "unknown unit 'furlong'"),
        ("0.5]", ".nan]", 6, "robots.P.start.2", "nan is not finite"),
        ("0.5]", "true]", 6, "robots.P.start.2", "True is not a number"),
        ("90 deg/s", "[1]", 8, "robots.P.joints.J1.velocity", "is not a number"),
        ("50 mm", "-50 mm", 10, "surroundings.post.shape.capsule.0", "'-50 mm' is too small; expected"),
        ("50 mm", "50 deg", 10, "surroundings.post.shape.capsule.0", "'50 deg' is not a length"),
        ("[50 mm, 1 m]", "[50 mm]", 10, "surroundings.post.shape.capsule.1", "an entry is missing"),
        ("[50 mm, 1 m]", "[1, 2, 3]", 10, "surroundings.post.shape.capsule", "3 entries; expected at most 2"),
        ("[50 mm, 1 m]", "7", 10, "surroundings.post.shape.capsule", "7 is not a list; expected [a, b"),
        ("capsule: [50 mm, 1 m]", "", 10, "surroundings.post.shape", "0 shapes; expected exactly one"),
        ("capsule:", "sphere: 1, capsule:", 10, "surroundings.post.shape", "2 shapes; expected exactly one"),
        ("capsule:", "prism:", 10, "surroundings.post.shape.prism", "unknown key 'prism'; expected one of"),
        ("[1, 1, 0]", "[1, .inf, 0]", 10, "surroundings.post.xyz.1", "inf is not finite"),
        ("  post:", "  a b:", 10, "surroundings.a b", "'a b' is not a valid name"),
    ],
)  # fmt: skip
def test_a_wrong_value_is_refused_with_its_line(write, old, new, line, path, message):
    error = refused(write((old, new)))
    assert (error.line, error.path) == (line, path)
    assert message in str(error)


@pytest.mark.parametrize(
    ("more", "path", "message"),
    [
        ("clock: {kind: lockstep, participants: []}", "clock.participants", "0 entries; expected at least 1"),
        ("clock: {kind: lockstep}", "clock.participants", "the key is missing"),
        ("clock: {kind: lockstep, participants: [a, a]}", "clock", "a participant is named twice"),
        ("clock: {kind: lockstep, participants: [a], grace: 0}", "clock.grace", "expected more than 0"),
        ("clock: {kind: wall, grace: 1}", "clock.grace", "unknown key 'grace'; expected one of kind"),
        ("clock: {kind: sun}", "clock", "kind 'sun' is not possible; expected one of 'wall', 'lockstep'"),
        ("clock: {}", "clock", "the key 'kind' is missing"),
        ("server: {port: 65536}", "server.port", "65536 is too large; expected at most 65535"),
        ("server: {port: 1.5}", "server.port", "1.5 is not a whole number"),
        ("server: []", "server", "[] is not a mapping; expected 'key: value'"),
        ("response: halt", "response", "'halt' is not possible; expected 'stop' or 'slow'"),
        ("max_age_ticks: 0", "max_age_ticks", "0 is too small; expected at least 1"),
        ("self_distance: 0", "self_distance", "0 is too small; expected more than 0"),
        ("stop_distance: .nan", "stop_distance", "nan is not finite"),
    ],
)
def test_a_wrong_section_is_refused_with_its_path(write, more, path, message):
    error = refused(write(more=more + "\n"))
    assert (error.line, error.path) == (11, path)
    assert message in str(error)


@pytest.mark.parametrize("text", ["robots: {}\n", "robots: 3\n"])
def test_a_cell_needs_robots(tmp_path, text):
    path = tmp_path / "cell.yaml"
    path.write_text("armgate: 1\nname: x\n" + text)
    assert refused(path).line == 3


def test_all_errors_are_listed(write):
    error = refused(write(("50 mm", "x"), more="response: halt\nstop_distance: -1\n"))
    assert [line.split(":")[1] for line in str(error).splitlines()] == ["10", "11", "12"]
    assert error.line == 10
    many = "".join(f"unknown_{i}: 1\n" for i in range(20))
    assert str(refused(write(more=many))).splitlines()[-1] == "… and 10 more"


GANTRY = "    gantry: {{travel: {{x: [0, 1], y: {y}, z: {z}}}, height: 3.0, span: 4.0}}\n"


@pytest.mark.parametrize(
    ("y", "z", "path", "message"),
    [
        ("[1, 0]", "[1, 2]", "robots.P.gantry.travel", "y goes from 1 to 0; expected the lower end first"),
        ("[-1, 1]", "[1, 3]", "robots.P.gantry", "in the bridge; expected travel.z below height (3 m)"),
        ("[-1, 1.8]", "[1, 2]", "robots.P.gantry", "runs into a rail; expected travel.y within ±1.6 m"),
    ],
)
def test_a_gantry_that_does_not_fit_is_refused(write, y, z, path, message):
    error = refused(write(("    start", GANTRY.format(y=y, z=z) + "    start")))
    assert (error.line, error.path) == (6, path)
    assert message in str(error)


@pytest.mark.parametrize(
    ("old", "new", "line", "path", "message"),
    [
        ("45 deg, 0.5]", "45 deg]", 6, "start", "2 values; expected 3, one for each of J1, J2, J3"),
        ("45 deg", "45 mm", 6, "start.1", "'45 mm' does not fit joint J2, which is revolute"),
        ("J1:", "J9:", 8, "joints.J9", "robot P has no joint 'J9'; expected one of J1, J2, J3"),
        ("velocity: 90 deg/s", "lower: -3", 8, "joints.J1.lower", "-3 is looser than the URDF's -2.9"),
        ("velocity: 90 deg/s", "upper: 3", 8, "joints.J1.upper", "3 is looser than the URDF's 2.9"),
        ("velocity: 90 deg/s", "lower: 1, upper: 1", 8, "joints.J1", "lower 1 is not below upper 1"),
        ("90 deg/s", "3 rad/s", 8, "joints.J1.velocity", "3 is not possible; expected"),
        ("90 deg/s", "0", 8, "joints.J1.velocity", "0 is not possible"),
        ("90 deg/s", "90 deg", 8, "joints.J1.velocity", "'90 deg' does not fit joint J1, which is revolute"),
        ("deceleration: null", "deceleration: 0", 8, "joints.J1.deceleration", "expected more than 0"),
        ("deceleration: null", "acceleration: -1", 8, "joints.J1.acceleration", "expected more than 0"),
        ("planar3.urdf", "none.urdf", 5, "urdf", "none.urdf cannot be read: No such file"),
        ("planar3.urdf", "../demo.yaml", 5, "urdf", "demo.yaml: not well-formed XML"),
    ],
)  # fmt: skip
def test_a_value_that_does_not_fit_the_model_is_refused_with_its_line(write, old, new, line, path, message):
    error = refused(write((old, new)), build=True)
    assert (error.line, error.path) == (line, f"robots.P.{path}")
    assert message in str(error)


@pytest.mark.parametrize(
    ("key", "path", "message"),
    [
        ("tool: hand", "tool", "there is no frame 'hand'; expected one of base_link"),
        ("camera: eye", "camera", "there is no frame 'eye'"),
        ("frames: {c: {parent: no}}", "frames.c", "there is no link 'no'; expected one"),
        ("frames: {tool0: {parent: tool0}}", "frames.tool0", "exists already"),
        ("bodies: {c: {link: no, shape: {sphere: 1}}}", "bodies.c", "there is no link"),
        ("bodies: {link_1: {link: link_2, shape: {sphere: 1}}}", "bodies.link_1", "twice"),
        ("ignore_pairs: [[link_1, no]]", "ignore_pairs.0.1", "is called 'no'; expected"),
    ],
)  # fmt: skip
def test_an_added_key_that_does_not_fit_the_model_is_refused(write, key, path, message):
    error = refused(write(("    joints", f"    {key}\n    joints")), build=True)
    assert (error.line, error.path) == (7, f"robots.P.{path}")
    assert message in str(error)


def test_body_names_that_are_too_long_are_refused(write):
    long = "b" * 64
    change = ("    joints", f"    bodies: {{{long}: {{link: link_1, shape: {{sphere: 1}}}}}}\n    joints")
    assert "is too long; expected at most 64 characters" in str(refused(write(change), build=True))


def test_a_urdf_that_is_not_text_is_refused(write, tmp_path):
    (tmp_path / "bad.urdf").write_bytes(b"\xff\xfe")
    path = write()
    text = path.read_text().splitlines()
    text[4] = "    urdf: bad.urdf"
    path.write_text("\n".join(text))
    assert "bad.urdf: line 1: not UTF-8; expected UTF-8: save the file as UTF-8" in str(
        refused(path, build=True)
    )


def test_errors_of_a_configuration_without_file_have_no_place():
    config = CellConfig(armgate=1, name="x", robots={"P": {"urdf": "nowhere.urdf", "start": (0.0,)}})
    with pytest.raises(ConfigError) as caught:
        build_cell(config)
    assert str(caught.value).startswith("robots.P.urdf: nowhere.urdf cannot be read")
    assert caught.value.line is None


@pytest.mark.parametrize("name", ["demo.yaml", "planar.yaml"])
def test_a_dumped_configuration_gives_the_same_cell(configs, name):
    config = load_config([configs / name])
    text = dump_config(config)
    again = CellConfig.model_validate(_tuples(yaml.safe_load(text)))
    assert again.model_dump() == config.model_dump()
    assert list(again.robots) == list(config.robots)
    assert "../" not in text


def test_null_deceleration_survives_the_dump(write, tmp_path):
    path = tmp_path / "again.yaml"
    config = load_config([write(("    joints:\n", "    joints:\n      J2: {velocity: 1.0}\n"))])
    path.write_text(dump_config(config))
    again = load_config([path])
    assert build_cell(again).hash == build_cell(config).hash


def _tuples(value):
    if isinstance(value, dict):
        return {key: _tuples(part) for key, part in value.items()}
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def test_reading_does_not_import_the_robot_model():
    code = (
        "import sys, armgate.cell.config, armgate.events, armgate.cell.urdf.gantry;"
        "sys.exit(bool({'pinocchio', 'coal', 'fcl'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_mapping_of_another_kind_is_replaced_not_merged(configs, tmp_path):
    overlay = tmp_path / "real.yaml"
    overlay.write_text("robots: {P: {link: {kind: rsi, ethernet: krc.xml, krc: 127.0.0.1}}}\n")
    link = load_config([configs / "planar.yaml", overlay]).robots["P"].link
    assert (link.kind, link.ethernet, link.krc, link.timeout) == ("rsi", "krc.xml", "127.0.0.1", 10)


@pytest.mark.parametrize(
    ("key", "text"),
    [
        ("krc: robot.local", "is not an IP address; expected one like"),
        ("krc: 127.0.0.1, listen: nowhere", "expected ADDRESS:PORT"),
        ("krc: 127.0.0.1, axes: {E1: {joint: x, sent: 0.0}}", "a factor of 0"),
        ("krc: 127.0.0.1, axes: {E7: {joint: x}}", "expected 'A1'"),
        ("krc: 127.0.0.1, lag: 3 deg", "is not a time"),
    ],
)
def test_a_wrong_rsi_link_is_refused_with_its_place(configs, tmp_path, key, text):
    overlay = tmp_path / "real.yaml"
    overlay.write_text("armgate: 1\nrobots: {P: {link: {kind: rsi, ethernet: krc.xml, " + key + "}}}\n")
    with pytest.raises(ConfigError, match=r"real.yaml:2: robots.P.link") as caught:
        load_config([configs / "planar.yaml", overlay])
    assert text in str(caught.value)


# --- empty and extreme values -------------------------------------------------------------------------------

SECTIONS = ["clock", "server", "recording", "metrics", "stop_distance", "response", "max_age_ticks"]
OF_A_ROBOT = ["base", "gantry", "frames", "bodies", "camera", "joints", "meshes", "ignore_pairs", "link"]


def test_empty_surroundings_count_as_absent(write):
    path = write(("  post: {shape: {capsule: [50 mm, 1 m]}, xyz: [1, 1, 0]}\n", ""))
    assert load_config([path]).surroundings == {}


@pytest.mark.parametrize("key", SECTIONS)
def test_an_empty_section_counts_as_absent_and_an_empty_value_is_refused(write, key):
    path = write(more=f"{key}:\n")
    if key in ("stop_distance", "response", "max_age_ticks"):
        error = refused(path)
        assert error.path == key
        assert "an empty value" in str(error)
    else:
        plain = load_config([write(name="plain.yaml")])
        assert getattr(load_config([path]), key) == getattr(plain, key)


@pytest.mark.parametrize("key", [*OF_A_ROBOT, "urdf", "tool", "start", "period", "lag_window", "q_tolerance"])
def test_an_empty_section_of_a_robot_counts_as_absent_and_an_empty_value_is_refused(configs, tmp_path, key):
    robot = {"urdf": str(configs / "robots/planar3.urdf"), "start": [0, 0, 0]}
    text = yaml.safe_dump({"armgate": 1, "name": "c", "robots": {"P": robot | {key: 99}}}, sort_keys=False)
    path = tmp_path / "c.yaml"
    path.write_text(text.replace("99", ""))
    if key in OF_A_ROBOT:
        assert load_config([path]).robots["P"].urdf.endswith("planar3.urdf")
    else:
        assert "an empty value" in str(refused(path))


@pytest.mark.parametrize(
    "more",
    ["surroundings: {a: }", "surroundings: {a: {shape: }}", "surroundings: {a: {shape: {sphere: 1}, xyz: }}"],
)
def test_an_empty_pose_or_shape_is_refused(write, more):
    whole = write(("surroundings:\n  post: {shape: {capsule: [50 mm, 1 m]}, xyz: [1, 1, 0]}\n", f"{more}\n"))
    assert "an empty value" in str(refused(whole))


def test_an_empty_section_of_an_overlay_changes_nothing(write, tmp_path):
    overlay = tmp_path / "over.yaml"
    overlay.write_text("armgate: 1\nsurroundings:\nrobots: {P: {joints: }}\n")
    config = load_config([write(), overlay])
    assert list(config.surroundings) == ["post"]
    assert list(config.robots["P"].joints) == ["J1"]
    overlay.write_text("armgate: 1\nsurroundings: null\n")
    assert load_config([write(), overlay]).surroundings == {}


@pytest.mark.parametrize(
    ("more", "text"),
    [
        ("max_age_ticks: " + "9" * 5000, "a number of 5000 digits"),
        ("stop_distance: 1" + "0" * 400, "a number of 401 digits"),
        ("stop_distance: 1e308", "stop_distance: 1e+308 is too large; expected at most 1000"),
        ("stop_distance: 1e999", "stop_distance: inf is not finite"),
        ("server: {lease_ttl: 1e300}", "lease_ttl: 1e+300 is too large"),
    ],
)
def test_extreme_numbers_are_refused(write, more, text):
    assert text in str(refused(write(more=more + "\n")))


@pytest.mark.parametrize(
    ("key", "value"),
    [("period", "1e-300"), ("period", "1e300"), ("base", "{xyz: [1e308, 0, 0]}"),
     ("base", "{rpy: [1e308, 0, 0]}"),
     ("bodies", "{a: {link: tool0, shape: {sphere: 1}, xyz: [1e308, 1e308, 0]}}"),
     ("q_tolerance", "1e300"),
     ("lag_window", "1e308"), ("joints", "{J2: {acceleration: 1e308}}"), ("start", "[1e308, 0, 0]")],
)  # fmt: skip
def test_extreme_numbers_of_a_robot_are_refused(write, key, value):
    old = "    start: [0 deg, 45 deg, 0.5]\n"
    kept = "" if key == "start" else old
    joints = "    joints:\n      J1: {velocity: 90 deg/s, deceleration: null}\n"
    whole = write((old, f"{kept}    {key}: {value}\n"), (joints, ""))
    error = refused(whole, build=key in ("joints", "start"))
    assert key in error.path
    assert "too large" in str(error) or "too small" in str(error) or "out of range" in str(error)


# --- descriptions, from which the reference is generated ----------------------------------------------------


def _config_models(model):
    for own in model.__subclasses__():
        if own.__module__.startswith(("armgate.cell.", "armgate.links.")):
            yield own
        yield from _config_models(own)


def _all_models():
    for kind in installed_kinds():
        load_kind(kind)  # imports its models
    return sorted(set(_config_models(ConfigModel)), key=lambda model: model.__name__)


@pytest.mark.parametrize("model", _all_models())
def test_every_model_and_field_has_a_description(model):
    assert model.__doc__
    assert model.__doc__.endswith(".")
    for name, field in model.model_fields.items():
        assert field.description, name
        assert field.description.endswith((".", "]")), name
