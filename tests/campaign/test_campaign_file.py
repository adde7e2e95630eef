"""File of a campaign: errors name file, line and key; values come from seed and key alone."""

import re
from pathlib import Path

import numpy as np
import pytest

from armgate.campaign.campaign_file import load_campaign
from armgate.campaign.distributions import Variation, generator
from armgate.campaign.drive import Campaign
from armgate.campaign.entries import EntryError
from armgate.campaign.laboratory import Laboratory
from armgate.cell.errors import ConfigError
from support.campaigns import PLANAR, small_campaign, write_campaign

EXAMPLES = sorted((Path(__file__).parents[2] / "configs" / "campaigns").glob("*.yaml"))


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda path: path.name)
def test_the_bundled_campaigns_are_valid(file: Path) -> None:
    found = Campaign.load(file)
    assert len({trial.key for trial in found.trials}) == len(found.trials) > 0


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("seeds: 4", "seeds: 0", r":5: seeds: 0 is too small; expected at least 1"),
        ("seeds: 4", "seed: 4", r":5: seed: unknown key 'seed'; did you mean 'seeds'"),
        ('program: "odd:move"', 'program: "odd"', r":7: controllers.move.P.program: "),
        ('program: "odd:move"', "robot: P", r":7: controllers.move.P: expected one of program and command"),
        ("{uniform: [40 deg, 50 deg]}", "{}", r":9: vary.*: 0 distributions; expected exactly one of"),
        ("[40 deg, 50 deg]", "[50 deg, 40 deg]", r":9: .*expected the smaller end first"),
        ("[40 deg, 50 deg]", "[-1, 1], log_uniform: [1, 2]", r":9: .*2 distributions"),
        ("{uniform: [40 deg, 50 deg]}", "{log_uniform: [-1, 1]}", r":9: .*expected a positive end"),
        ("cell.robots.P.start.1", "robots.P.start.1", r":9: vary\.robots"),
        ("cell.robots.P.start.1", "controllers.Q.delay", r":9: .*no participant 'Q'; expected one of P"),
        ("cell.robots.P.start.1", "controllers.P.program", r":9: .*expected options.NAME, delay or jitter"),
        ("more", "until: [X]", r":10: until: there is no 'X'; expected one of P"),
        ("more", "claims: [{claim: a, figure: speedd, aggregate: max, at_most: 1}]", r"no figure 'speedd'"),
        ("more", "claims: [{claim: a, figure: late, aggregate: max}]", r"one of at_most and at_least"),
        ("more", "claims: [{claim: a, figure: late, aggregate: top, at_most: 1}]", r":10: claims.0.aggre"),
        ("more", "scenarios: {a: {set: {cell.robots.P.start.9: 1}}}", r":10: robots.P.start.9: the list"),
        ("more", "scenarios: {a: {set: {cell.robot.P.start: 1}}}", r":10: robot: unknown key 'robot'"),
        ("more", "scenarios: {a: {set: {cell.name: x}, vary: {cell.name: {choice: [y]}}}}", r":10: .*also s"),
        ('"odd:move"', '"odd"', r":7: controllers.move.P.program: 'odd'; expected package.module:function"),
        ("cell.robots.P.start.1", "robots.P", r":9: vary.*'robots.P'; expected cell.… or controllers.…"),
        ("[40 deg, 50 deg]", "[-1e308, 1e308]", r":9: .*is too wide; expected a finite difference"),
        ("[40 deg, 50 deg]", "[40 deg, 50 mm]", r":9: .*units of angle and length; expected units of one k"),
        ("[40 deg, 50 deg]", "[40 mm, 50 mm]", r":9: .* does not fit joint J2, which is revolute; exp"),
        ("{uniform: [40 deg, 50 deg]}", "{integer: [0, 10000000000000000000]}", r":9: .*is too large; ex"),
        ("{uniform: [40 deg, 50 deg]}", "{choice: [.nan]}", r":9: .*nan is not finite; expected a finite n"),
        ("{uniform: [40 deg, 50 deg]}", "{choice: [a, b]}", r":9: .*cannot read '[ab]'; expected a number"),
        ("cell.robots.P.start.1", "cell.robots.P.start.9", r":9: robots.P.start.9: the list"),
        ("cell.robots.P.start.1", "cell.robots.Q.start", r":9: robots.Q.\w+: the key is missing"),
        ("cell.robots.P.start.1", "controllers.P.options.a", r":7: .*odd:move\(context\): got an unexpected"),
        ("cell.robots.P.start.1", "controllers.P.options", r":9: .*options: .* is not a mapping"),
        ("[40 deg, 50 deg]}", "[0, 1]}\n  controllers.P.delay: {uniform: [-2, -1]}", r":10: .* is too small"),
        ('"odd:move"', '"odd:move", robot: Q', r":7: controllers.move.P.robot: there is no robot 'Q'; expe"),
        ('"odd:move"', '"odd:move", options: {a: .inf}', r":7: .*inf is not finite; expected a finite num"),
        ('{P: {program: "odd:move"}', '{X: {program: "odd:move", delay: 1 s}', r":7: .*without a robot; "),
        ('"odd:move"}', '"odd:move"}, X: {program: "odd:move", robot: P}', r":7: .*X: P commands P, too; "),
        ('program: "odd:move"', "command: [/no/such]", r":7: .*command: /no/such: there is no such command"),
        ("seeds: 4", "seeds: 1000001", r":5: seeds: 1000001 trials in all; expected at most 1000000"),
        ("seeds: 4", "seeds: 4\nfirst_seed: 10000000000000000000", r":6: first_seed: .* is too large; ex"),
        ("more", "figures: {ticks: {function: 'odd:ticks', options: {a: 1}}}", r":10: figures.ticks.options"),
    ],
)  # fmt: skip
def test_an_error_names_file_line_and_key(tmp_path: Path, before: str, after: str, message: str) -> None:
    file = write_campaign(tmp_path, more="more")
    text = file.read_text().replace(before, after)
    assert text != file.read_text()
    file.write_text(text if before == "more" else text.replace("\nmore", ""))
    with pytest.raises(ConfigError, match=message) as caught:
        Campaign.load(file)
    assert str(file) in str(caught.value)


def test_a_link_with_a_clock_of_its_own_is_one_error_before_any_trial(tmp_path: Path) -> None:
    configs = PLANAR.parent
    file = write_campaign(tmp_path)
    cell = f"cell: [{configs}/demo.yaml, {configs}/links/rsi-virtual.yaml]"
    text = (
        file.read_text()
        .replace(f"cell: [{PLANAR}]", cell)
        .replace("{P: {", "{FR: {")
        .replace("s.P.", "s.FR.")
    )
    file.write_text(text)
    with pytest.raises(ConfigError, match=r"rsi-virtual.yaml:\d+: robots.*link.kind: 'rsi' has a clock of"):
        Campaign.load(file)


def test_some_drawn_values_may_be_invalid(tmp_path: Path) -> None:
    file = write_campaign(tmp_path)
    text = file.read_text().replace(
        "start.1: {uniform: [40 deg, 50 deg]}", "link.lag: {uniform: [-1 s, 1 s]}"
    )
    file.write_text(text)
    campaign = Campaign.load(file)
    results = [Laboratory(campaign.config, campaign.basis).run(trial) for trial in campaign.trials]
    assert {result.failed for result in results} == {True, False}


def test_an_entry_that_cannot_be_imported_is_an_error(tmp_path: Path) -> None:
    file = write_campaign(tmp_path, programs=("missing",))
    with pytest.raises(EntryError, match=r"odd:missing: odd has no function missing"):
        Campaign.load(file)
    (tmp_path / "odd.py").write_text("import nothing_of_this_name")
    with pytest.raises(EntryError, match=r"odd:missing: odd has no|cannot be imported"):
        Campaign.load(file)


# --- random values ------------------------------------------------------------------------------------------


def test_values_depend_on_seed_and_key_only(tmp_path: Path) -> None:
    alone = small_campaign(tmp_path, seeds=3)
    values = {trial.seed: dict(trial.values) for trial in alone.trials}
    more = "  controllers.P.delay: {uniform: [0, 1 s]}\nscenarios: {a: {}, b: {}}"
    both = small_campaign(tmp_path, seeds=5, programs=("move", "ends"), more=more)
    for trial in both.trials[: 3 * 4]:
        assert dict(trial.values)["cell.robots.P.start.1"] == values[trial.seed]["cell.robots.P.start.1"]
    assert len({trial.key for trial in both.trials}) == 5 * 4


def test_a_key_changes_with_everything_that_determines_the_trial(tmp_path: Path) -> None:
    (first,) = small_campaign(tmp_path, seeds=1).trials
    file = tmp_path / "small.yaml"
    text = file.read_text()
    keys = {first.key}
    for before, after in [
        ("60 ms", "72 ms"), ("uniform: [40", "uniform: [41"), ("odd:move", "odd:ends"),
        ("seeds: 1", "seeds: 1\nfirst_seed: 7"),
        ("seeds: 1", "seeds: 1\nscenarios: {default: {set: {cell.stop_distance: 25 mm}}}"),
        ("seeds: 1", "seeds: 1\nfigures: {ticks: {function: 'odd:ticks'}}"),
    ]:  # fmt: skip
        file.write_text(text.replace(before, after))
        keys |= {trial.key for trial in Campaign.load(file).trials}
    file.write_text(text.replace("seeds: 1", "seeds: 1\ntimeout: 5 s\nattempts: 9"))
    assert Campaign.load(file).trials == [first]
    assert len(keys) == 7


def test_a_changed_source_changes_the_keys(tmp_path: Path) -> None:
    before = small_campaign(tmp_path).basis.sources["odd:move"]
    (tmp_path / "odd.py").write_text((tmp_path / "odd.py").read_text() + "\n# changed\n")
    assert Campaign.load(tmp_path / "small.yaml").basis.sources["odd:move"] != before


@pytest.mark.parametrize(
    ("given", "low", "high", "mean"),
    [
        ({"uniform": (1.0, 3.0)}, 1.0, 3.0, 2.0),
        ({"log_uniform": (1.0, 100.0)}, 1.0, 100.0, 99.0 / np.log(100.0)),
        ({"integer": (1, 5)}, 1.0, 5.0, 3.0),
        ({"normal": {"mean": 1.0, "sigma": 2.0}}, -9.0, 11.0, 1.0),
        ({"normal": {"mean": 0.0, "sigma": 1.0, "lower": 0.0, "upper": 5.0}}, 0.0, 5.0, np.sqrt(2 / np.pi)),
        ({"choice": (1.0, 2.0, 6.0)}, 1.0, 6.0, 3.0),
    ],
)
def test_distributions_have_their_range_and_mean(given: dict, low: float, high: float, mean: float) -> None:
    variation = Variation.model_validate(given)
    values = np.array([variation.draw(generator(seed, "key")) for seed in range(3000)], dtype=float)
    assert low <= values.min() <= values.max() <= high
    assert values.mean() == pytest.approx(mean, abs=4.0 * values.std() / np.sqrt(len(values)))
    assert len(np.unique(values)) > (2 if "choice" in given or "integer" in given else 2900)


def test_numbers_have_units(tmp_path: Path) -> None:
    file = write_campaign(tmp_path)
    starts = [dict(trial.values)["cell.robots.P.start.1"] for trial in Campaign.load(file).trials]
    assert all(np.radians(40.0) <= start <= np.radians(50.0) for start in starts)
    file.write_text(file.read_text().replace("50 deg", "50 degrees"))
    with pytest.raises(ConfigError, match=r"small.yaml:9: .*unknown unit 'degrees'"):
        load_campaign(file)


def test_fixed_and_drawn_values_reach_the_cell(tmp_path: Path) -> None:
    more = f"scenarios: {{a: {{set: {{cell.robots.P.link.lag: 70 ms}}}}, b: {{cell: [{PLANAR}]}}}}"
    campaign = small_campaign(tmp_path, seeds=1, more=more)
    laboratory = Laboratory(campaign.config, campaign.basis)
    for trial in campaign.trials:
        cell = laboratory.cell(trial)
        assert cell.robot("P").start[1] == dict(trial.values)["cell.robots.P.start.1"]
        assert cell.robot("P").lags == ((0.07,) * 3 if trial.scenario == "a" else (0.0,) * 3)


def test_an_overlay_of_a_scenario_is_part_of_its_cell(tmp_path: Path) -> None:
    (tmp_path / "far.yaml").write_text("armgate: 1\nstop_distance: 40 mm\n")
    campaign = small_campaign(tmp_path, more="scenarios: {near: {}, far: {cell: [far.yaml]}}")
    assert len(set(campaign.basis.cells.values())) == 2
    laboratory = Laboratory(campaign.config, campaign.basis)
    found = {trial.scenario: laboratory.cell(trial).config.stop_distance for trial in campaign.trials}
    assert found == {"near": 0.02, "far": 0.04}


def test_names_with_dots_are_found(tmp_path: Path) -> None:
    (tmp_path / "dots.yaml").write_text(
        "armgate: 1\nsurroundings: {post.1: {shape: {box: [0.1, 0.1, 0.1]}, xyz: [2, 2, 2]}}\n"
    )
    more = "  cell.surroundings.post.1.xyz.0: {uniform: [2, 3]}\nscenarios: {a: {cell: [dots.yaml]}}"
    campaign = small_campaign(tmp_path, seeds=1, more=more)
    (trial,) = campaign.trials
    cell = Laboratory(campaign.config, campaign.basis).cell(trial)
    (post,) = (body for body in cell.surroundings if body.name == "post.1")
    assert post.placement.t[0] == dict(trial.values)["cell.surroundings.post.1.xyz.0"]
    assert re.fullmatch("[0-9a-f]{16}", trial.key)
