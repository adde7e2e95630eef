"""``armgate check`` and warnings of ``armgate serve``: cells without pairs, distances, violations."""

import io
import json
from itertools import pairwise

import numpy as np
import pytest
import yaml
from rich.console import Console

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.daemon.lifecycle.check import report
from armgate.daemon.lifecycle.commands import _warn
from armgate.gate import Gate, start_clearances
from armgate.links.log import Log

SLIDER = """<robot name="a"><link name="base"/><link name="l1">{}</link><link name="tool0"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="l1"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" velocity="0.2" effort="1"/></joint>
<joint name="t" type="fixed"><parent link="l1"/><child link="tool0"/></joint></robot>"""
BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


def cell_of(tmp_path, surroundings, body=BOX, start=0.0, **more):
    (tmp_path / "a.urdf").write_text(SLIDER.format(body))
    whole = {"armgate": 1, "name": "c", "robots": {"R": {"urdf": "a.urdf", "start": [start]}}, **more}
    if surroundings:
        whole["surroundings"] = surroundings
    (tmp_path / "c.yaml").write_text(yaml.safe_dump(whole))
    return build_cell(load_config([tmp_path / "c.yaml"]))


def box(size, xyz):
    return {"shape": {"box": size}, "xyz": xyz}


def printed(cell):
    out = io.StringIO()
    status = report(cell, Console(file=out, width=80))
    return status, out.getvalue()


@pytest.mark.parametrize("body", [BOX, ""])
def test_a_cell_without_pairs_is_checked_and_its_gate_works(tmp_path, body):
    cell = cell_of(tmp_path, None, body)
    status, text = printed(cell)
    assert status == 0
    assert "warning: no pair of bodies must stay apart" in text
    assert ("no moving link has a body" in text) is (body == "")
    Gate(cell, "0" * 16)


TWO = {"near": box([0.1, 0.1, 0.1], [0.2, 0, 0]), "diag": box([0.1, 0.4, 0.1], [-0.25, 0.3, 0])}


@pytest.mark.parametrize("self_distance", [0.001, 0.2])
@pytest.mark.parametrize("stop_distance", [0.001, 0.05, 0.3])
def test_printed_distances_are_correct_for_any_required_distance(tmp_path, stop_distance, self_distance):
    cell = cell_of(tmp_path, TWO, stop_distance=stop_distance, self_distance=self_distance)
    status, text = printed(cell)
    assert "100.0 mm" in text
    assert "158.1 mm" in text
    assert status == (stop_distance == 0.3)


def test_the_distances_of_the_nearest_of_many_pairs_are_true(tmp_path):
    rng = np.random.default_rng(0)
    places = rng.uniform(0.4, 2.0, (60, 3)) * rng.choice([-1, 1], (60, 3))
    around = {f"s{i}": {"shape": {"sphere": 0.05}, "xyz": xyz} for i, xyz in enumerate(places.tolist())}
    cell = cell_of(tmp_path, around)
    outside = np.maximum(np.abs(places) - 0.05, 0.0)
    true = np.sort(np.linalg.norm(outside, axis=1) - 0.05)
    found = [near.distance for near in start_clearances(cell, count=8)]
    assert all(a <= b for a, b in pairwise(found))
    assert found[:8] == pytest.approx(true[:8], abs=1e-6)


def test_all_violations_are_listed_or_counted(tmp_path):
    many = {f"s{i}": box([0.2, 0.2, 0.2], [0, 0, 0.1 + i / 10000]) for i in range(150)}
    status, text = printed(cell_of(tmp_path, many))
    assert status == 1
    assert sum("the distance to keep is 50 mm" in line for line in text.splitlines()) == 64
    assert "… and 86 more" in text
    assert "overlap of 50.0 mm" in text
    assert "ignore_pairs" in text


def test_no_distance_is_minus_zero_and_starts_have_units(tmp_path):
    status, text = printed(cell_of(tmp_path, {"table": box([1, 1, 0.1], [0, 0, -0.1])}, start=0.05))
    assert status == 1
    assert "-0.0" not in text
    assert "joint slide starts at 50 mm, outside its limits 0 mm to 40 mm" in text


def test_serve_warns_of_what_check_refuses(tmp_path):
    stream = io.StringIO()
    log = Log(stream)
    _warn(cell_of(tmp_path, {"near": box([0.1, 0.1, 0.1], [0.11, 0, 0])}), log)
    _warn(cell_of(tmp_path, None), log)
    _warn(cell_of(tmp_path, TWO), log)
    log.close()
    close, none = map(json.loads, stream.getvalue().splitlines())
    assert (close["level"], close["event"]) == ("warning", "start")
    assert close["faults"] == ["R/l1 – near: 10.0 mm apart at the start; the distance to keep is 50 mm"]
    assert "ignore_pairs" in close["remedy"]
    assert (none["event"], none["text"][:30]) == ("remark", "no pair of bodies must stay ap")


def test_lags_are_reported_as_the_gate_assumes_them(tmp_path):
    cell = cell_of(tmp_path, None)
    assert "R: lags 30 ms, axes differ by at most 0 ms; delay at most 0 ms" in printed(cell)[1]
    robot = {"urdf": "a.urdf", "start": [0.0], "lag_difference": "2 ms", "lag_window": "24 ms"}
    robot["link"] = {"kind": "emulated", "lags": {"slide": "33 ms"}}
    (tmp_path / "d.yaml").write_text(yaml.safe_dump({"armgate": 1, "name": "c", "robots": {"R": robot}}))
    text = printed(build_cell(load_config([tmp_path / "d.yaml"])))[1]
    assert "R: lags 33 ms, axes differ by at most 2 ms; delay at most 24 ms" in text
