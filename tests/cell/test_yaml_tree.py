import os
from pathlib import Path

import pytest

from armgate.cell.config.yaml_tree import MAX_BYTES, read_tree
from armgate.cell.errors import ConfigError


@pytest.fixture
def write(tmp_path):
    def write(name, text):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_scalars_follow_the_core_schema(write):
    text = (
        "a: 1e-4\nb: on\nc: 1:30\nd: 010\ne: ~\nf: true\ng: .inf\nh: -.5\ni: '1'\nj: 2001-01-01\nk:\nl: -2\n"
    )
    assert read_tree([write("a.yaml", text)]).plain() == {
        "a": 1e-4, "b": "on", "c": "1:30", "d": 10, "e": None, "f": True, "g": float("inf"), "h": -0.5,
        "i": "1", "j": "2001-01-01", "k": None, "l": -2,
    }  # fmt: skip


def test_mappings_merge_and_everything_else_is_replaced(write):
    below = write("a.yaml", "m: {a: 1, b: {c: 2}}\nl: [1, 2, 3]\ns: 1\nn: {x: 1}\n")
    above = write("b.yaml", "m: {b: {d: 3}, a: 4}\nl: [9]\nn: null\nnew: 5\n")
    tree = read_tree([below, above])
    assert tree.plain() == {"m": {"a": 4, "b": {"c": 2, "d": 3}}, "l": (9,), "s": 1, "n": None, "new": 5}
    assert list(tree.plain()["m"]) == ["a", "b"]
    assert tree.locate(("m", "b", "c")).file == below
    assert tree.locate(("m", "b", "d")).file == above


def test_values_keep_their_lines(write):
    path = write("a.yaml", "a:\n  b:\n    - 1\n    - c: 2\n  d: 3\n")
    tree = read_tree([path])
    lines = [tree.locate(p).line for p in (("a",), ("a", "b"), ("a", "b", 0), ("a", "b", 1, "c"), ("a", "d"))]
    assert lines == [1, 2, 3, 4, 5]
    assert tree.locate(("a", "missing")).line == 1


def test_aliases_are_allowed(write):
    assert read_tree([write("a.yaml", "a: &x {b: 1}\nc: *x\n")]).plain() == {"a": {"b": 1}, "c": {"b": 1}}


BOMB = "a0: &a0 [1]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 9))


@pytest.mark.daily(8)
@pytest.mark.parametrize(
    ("text", "line", "message"),
    [
        ("", 1, "the file is empty; expected a mapping"),
        ("# nothing\n", 1, "the file is empty"),
        ("[1]", 1, "not a mapping; expected 'key: value'"),
        ("text", 1, "not a mapping"),
        ("a: 1\nb: 2\na: 3\n", 3, "a: the key is repeated; expected it once (first in line 1)"),
        ("a:\n  b: 1\n  b: 2\n", 3, "a.b: the key is repeated"),
        (b"a: 1\nb: \xff\n", 2, "not UTF-8"),
        ("a: 1\nb: \x01\n", 2, "the character '\\x01' is not allowed"),
        ("a: [1\nb: 2", 2, "not YAML: "),
        ("a: 1\n\tb: 2\n", 2, "not YAML: "),
        ("a: *x", 1, "not YAML: found undefined alias 'x'"),
        ("a: 1\n---\nb: 1\n", 2, "expected a single document"),
        ("a: !x 1", 1, "a: the tag '!x' is not known"),
        ("a:\n  - &x [*x]", 2, "the alias refers to a value that contains it"),
        ("? [1]\n: 2", 1, "a key is not a text"),
        (BOMB, 1, "more than 100000 values"),
        ("a: " + "[" * 5000, 1, "nested too deeply"),
        ("a: 1\nb: !!int abc\n", 2, "b: 'abc' does not fit its tag 'tag:yaml.org,2002:int'; remove the tag"),
        ("a: [1, !!float x]\n", 1, "a.1: 'x' does not fit its tag"),
        ("a: !!bool abc\n", 1, "a: 'abc' does not fit its tag"),
        ("a: !!null abc\n", 1, "a: 'abc' does not fit its tag"),
        ("a: !!set {b}\n", 1, "a: the tag 'tag:yaml.org,2002:set' is not known"),
        ("a: !!python/object/apply:os.system [id]\n", 1, "a: the tag "),
        ('a: "x\\0y"\n', 1, "a: the character '\\x00' is not allowed; remove it"),
        ('a: 1\n"\\uD800": 1\n', 2, "the character '\\ud800' is not allowed; remove it"),
    ],
)
def test_errors_give_file_and_line(write, text, line, message):
    path = write("bad.yaml", text)
    with pytest.raises(ConfigError) as caught:
        read_tree([path])
    assert str(caught.value).startswith(f"{path}:{line}: ")
    assert message in str(caught.value)
    assert (caught.value.file, caught.value.line) == (path, line)


def test_files_that_cannot_be_read_are_refused(tmp_path, write):
    with pytest.raises(ConfigError, match=r"nope\.yaml: cannot be read: No such file"):
        read_tree([tmp_path / "nope.yaml"])
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        read_tree([tmp_path])
    with pytest.raises(ConfigError, match="no configuration file given"):
        read_tree([])
    with pytest.raises(ConfigError, match="more than 4194304 bytes"):
        read_tree([write("big.yaml", b"#" * (MAX_BYTES + 1))])


def test_an_error_in_the_second_file_names_it(write):
    good, bad = write("a.yaml", "a: 1\n"), write("b.yaml", "b: 1\nb: 2\n")
    with pytest.raises(ConfigError) as caught:
        read_tree([good, bad])
    assert caught.value.file == bad


def test_values_that_fit_their_explicit_tags_are_read(write):
    text = "a: !!str 1\nb: !!int 2\nc: !!float 1.5\nd: !!map {e: !!seq [1]}\nf: !!null\n"
    assert read_tree([write("a.yaml", text)]).plain() == {
        "a": "1", "b": 2, "c": 1.5, "d": {"e": (1,)}, "f": None,
    }  # fmt: skip


def test_devices_pipes_and_folders_are_refused(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path, reason in (
        (Path("/dev/zero"), "it is a device or pipe; expected a regular file"),
        (pipe, "it is a device or pipe; expected a regular file"),
        (tmp_path, "Is a directory; check the path"),
        (tmp_path / ("a" * 300), "File name too long; check the path"),
        (tmp_path / "a\0b", "no file can have this name; check the path"),
    ):
        with pytest.raises(ConfigError) as caught:
            read_tree([path])
        assert f"{path}: cannot be read: {reason}" in str(caught.value)
