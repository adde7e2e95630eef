"""Campaigns with worker processes: kills, errors, interruption, reproduction, report."""

import json
import os
import re
import signal
from collections.abc import Callable, Sequence
from html.parser import HTMLParser
from pathlib import Path

import pytest

from armgate.campaign.claims import aggregate, check_claims
from armgate.campaign.drive import Campaign, run_campaign
from armgate.campaign.errors import CampaignError, UsageError
from armgate.campaign.laboratory import Laboratory, WorkerError
from armgate.campaign.local_pool import LocalPool
from armgate.campaign.pool import Finished, Plan
from armgate.campaign.reproduce import reproduce_trial
from armgate.campaign.result import Result
from armgate.campaign.store import read_results
from armgate.campaign.trials import Trial
from armgate.recording import Recording
from support.campaigns import small_campaign


class InProcess:
    """Pool without processes; calls a function before each batch."""

    workers = 1

    def __init__(self, plan: Plan, before: Callable[[int], object] = lambda _: None) -> None:
        self._laboratory = Laboratory(plan.campaign, plan.basis)
        self._before, self._waiting, self._number = before, [], 0

    def submit(self, batch: Sequence[Trial]) -> None:
        self._waiting.append(batch)

    def wait(self) -> Finished:
        self._number += 1
        self._before(self._number)
        return Finished([self._laboratory.run(trial) for trial in self._waiting.pop(0)], seconds=9.0)

    def __enter__(self) -> "InProcess":
        return self

    def __exit__(self, *_: object) -> None: ...


def interrupt_at(number: int) -> Callable[[int], None]:
    def before(now: int) -> None:
        if now == number:
            raise KeyboardInterrupt

    return before


def test_a_campaign_survives_controllers_that_end_their_worker(tmp_path: Path) -> None:
    programs = ("move", "bad", "killed", "quits", "stuck", "ends", "reads", "leaves", "interrupts", "silent")
    campaign = small_campaign(tmp_path, seeds=2, programs=programs, more="timeout: 1.5 s\nattempts: 1")
    summary = run_campaign(campaign, tmp_path / "out", lambda plan: LocalPool(plan, 2))
    assert (summary.done, summary.failed) == (20, 16)
    results = read_results(tmp_path / "out")
    reasons = {trial.controllers: results[trial.key].reason for trial in campaign.trials}
    assert reasons["move"] == reasons["ends"] == ""
    assert reasons["bad"] == "ZeroDivisionError: division by zero"
    assert reasons["killed"] == reasons["quits"] == reasons["stuck"]
    assert "its worker process ended at every attempt, or the timeout of 1.5 s passed" in reasons["stuck"]
    assert reasons["reads"] == "FileNotFoundError: [Errno 2] No such file or directory: '/no/such/file'"
    assert (reasons["leaves"], reasons["interrupts"]) == ("SystemExit: 4", "KeyboardInterrupt:")
    assert reasons["silent"] == "Wordless"
    ended = {t.controllers: results[t.key].figures.get("duration") for t in campaign.trials}
    assert ended["ends"] < ended["move"]


def test_workers_that_are_killed_change_nothing(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, seeds=12)
    run_campaign(campaign, tmp_path / "undisturbed", InProcess)
    pools: list[LocalPool] = []

    class Killed(LocalPool):
        def wait(self) -> Finished:
            if len(pools) == 1 and len(self.processes) == 2:
                pools.append(self)
                for process in self.processes:
                    os.kill(process, signal.SIGKILL)
            return super().wait()

    def make(plan: Plan) -> LocalPool:
        pools.append(Killed(plan, 2))
        return pools[0]

    run_campaign(campaign, tmp_path / "killed", make)
    assert len(pools) == 2
    tables = [(tmp_path / name / "results.parquet").read_bytes() for name in ("undisturbed", "killed")]
    assert tables[0] == tables[1]


def test_an_interrupted_campaign_continues(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path)
    whole = run_campaign(campaign, tmp_path / "whole", InProcess)
    assert not whole.interrupted
    cut = run_campaign(campaign, tmp_path / "cut", lambda plan: InProcess(plan, interrupt_at(3)))
    assert cut.interrupted
    assert cut.done == 2
    assert "Incomplete" in (tmp_path / "cut" / "report.html").read_text()
    runs: list[int] = []
    run_campaign(campaign, tmp_path / "cut", lambda plan: InProcess(plan, runs.append))
    assert runs == [1, 2]
    tables = [(tmp_path / name / "results.parquet").read_bytes() for name in ("whole", "cut")]
    assert tables[0] == tables[1]
    again = run_campaign(campaign, tmp_path / "cut", lambda plan: pytest.fail("nothing is missing"))
    assert again.done == 4


def test_a_changed_file_is_refused_but_claims_may_change(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path)
    run_campaign(campaign, tmp_path / "out", InProcess)
    file = tmp_path / "small.yaml"
    text = file.read_text()
    file.write_text(text.replace("60 ms", "0.072"))
    with pytest.raises(UsageError, match=r"campaign.duration: 0.06 before, 0.072 now"):
        run_campaign(Campaign.load(file), tmp_path / "out", InProcess)
    file.write_text(text + "claims: [{claim: moves, figure: travel, aggregate: min, at_least: 0}]")
    with pytest.raises(Exception, match=r"no figure 'travel'; expected one of failed, duration"):
        Campaign.load(file)
    file.write_text(text + "claims: [{claim: moves, figure: P.travel, aggregate: min, at_least: 0}]")
    summary = run_campaign(Campaign.load(file), tmp_path / "out", lambda _: pytest.fail("nothing is missing"))
    assert [claim.holds for claim in summary.claims] == [True]


def test_a_worker_with_other_software_ends_the_campaign(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path)
    campaign.basis.versions["numpy"] = "0.1"  # type: ignore[index]
    with pytest.raises(WorkerError, match=r"versions: numpy is .* on this worker; the campaign has 0.1"):
        run_campaign(campaign, tmp_path / "out", lambda plan: LocalPool(plan, 1))
    campaign = small_campaign(tmp_path)
    campaign.basis.cells["default"] = "0" * 64  # type: ignore[index]
    with pytest.raises(WorkerError, match="cell of the scenario default: hash is"):
        run_campaign(campaign, tmp_path / "other", lambda plan: LocalPool(plan, 1))
    assert read_results(tmp_path / "other") == {}


# --- figures ------------------------------------------------------------------------------------------------


def test_own_figures_are_computed(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, seeds=1, more="figures: {ticks: {function: 'odd:ticks'}}")
    (trial,) = campaign.trials
    figures = Laboratory(campaign.config, campaign.basis).run(trial).figures
    assert figures["ticks"] == 6.0  # ticks at 0, 12, … 60 ms
    assert figures["commands"] == figures["P.commands"] == figures["admitted"] == 5.0
    assert figures["duration"] == pytest.approx(0.06)
    assert figures["P.travel"] == pytest.approx(0.004)
    assert figures["P.energy"] == pytest.approx(4 * 0.001**2 / 0.012)
    assert figures["P.tracking_max"] == pytest.approx(0.001)
    assert figures["min_clearance"] == figures["P.min_clearance"] > 0.02
    campaign = small_campaign(tmp_path, seeds=1, more="figures: {ticks: {function: 'odd:infinite'}}")
    (trial,) = campaign.trials
    found = Laboratory(campaign.config, campaign.basis).run(trial)
    assert found.reason == "FigureError: figure ticks is inf; expected a finite number, or None for no value"


def test_a_late_program_moves_later(tmp_path: Path) -> None:
    more = "  controllers.P.delay: {choice: [24 ms]}\n  controllers.P.jitter: {choice: [24 ms]}"
    prompt, late = (small_campaign(tmp_path, seeds=1, more=text) for text in ("", more))
    commands = [Laboratory(c.config, c.basis).run(c.trials[0]).figures["commands"] for c in (prompt, late)]
    assert commands[0] == 5.0
    assert 1.0 <= commands[1] <= 3.0


# --- claims and report --------------------------------------------------------------------------------------

CLAIMS = """
claims:
  - {claim: <near>, figure: min_clearance, aggregate: p5, at_least: 20 mm}
  - {claim: all run, figure: failed, aggregate: sum, at_most: 0}
  - {claim: too much, figure: commands, aggregate: max, at_most: 3}
  - {claim: as many, figure: commands, aggregate: mean, at_least: 1, compared_with: move}
  - {claim: nothing, figure: signal.none.max, aggregate: max, at_most: 1}
"""


def test_claims_hold_or_not_and_name_their_worst_trials(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, programs=("move", "ends"), more=CLAIMS)
    laboratory = Laboratory(campaign.config, campaign.basis)
    results = {trial.key: laboratory.run(trial) for trial in campaign.trials}
    near, run, much, many, nothing = check_claims(campaign.config, campaign.trials, results, complete=True)
    assert [one.holds for one in (near, run, much, many, nothing)] == [True, True, False, False, None]
    assert (much.value, much.goal, much.trials) == (5.0, 3.0, 8)
    assert many.goal == 5.0
    assert many.trials == 4
    assert nothing.missing == 8
    nearest = min(results.values(), key=lambda result: result.figures["min_clearance"])
    assert near.worst[0][0].key == nearest.key
    part = dict(list(results.items())[:2])
    checked = check_claims(campaign.config, campaign.trials, part, complete=False)
    assert [one.holds for one in checked[:3]] == [None, None, False]


def test_a_failed_trial_supports_no_claim(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, seeds=2, more=CLAIMS)
    first, second = campaign.trials
    good = Laboratory(campaign.config, campaign.basis).run(first)
    results = {first.key: good, second.key: Result(second.key, "broke")}
    near, run, *_ = check_claims(campaign.config, campaign.trials, results, complete=True)
    assert near.holds is False
    assert (run.holds, run.value) == (False, 1.0)


@pytest.mark.parametrize(
    ("name", "value"),
    [("min", 0.0), ("max", 9.0), ("mean", 3.0), ("median", 2.0), ("sum", 15.0), ("share", 0.8), ("p75", 3.0)],
)
def test_aggregates(name: str, value: float) -> None:
    assert aggregate(name, [0.0, 1.0, 2.0, 3.0, 9.0]) == value
    assert aggregate(name, []) is None


class _Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.outside: list[str] = []
        self.pictures = 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag not in ("meta", "br", "path", "polyline", "link", "img"):
            self.open.append(tag)
        self.pictures += tag == "svg"
        self.outside += [v for k, v in attrs if k in ("src", "href") and v and not v.startswith("trials/")]

    def handle_endtag(self, tag: str) -> None:
        if tag not in ("path", "polyline"):
            assert self.open.pop() == tag


def test_the_report_is_self_contained_and_names_the_worst_trials(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, seeds=3, programs=("move", "bad"), more=CLAIMS)
    run_campaign(campaign, tmp_path / "out", InProcess)
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    page = _Page()
    page.feed(text)
    assert page.open == page.outside == []
    assert page.pictures >= 8
    assert "&lt;near&gt;" in text
    assert "<near>" not in text
    assert "6 of 6 trials, 3 failed" in text
    assert "ZeroDivisionError" in text
    for trial in campaign.trials:
        command = f"armgate campaign {tmp_path}/small.yaml --out {tmp_path}/out --trial {trial.key}"
        assert command in text
        assert f'href="trials/{trial.key}/"' in text


# --- reproduction -------------------------------------------------------------------------------------------


def test_a_trial_is_reproduced_with_its_recording(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path)
    trial = campaign.trials[2]
    before = list(reproduce_trial(campaign, tmp_path / "out", trial.key))
    assert before[-1].startswith("not compared")
    run_campaign(campaign, tmp_path / "out", InProcess)
    for _ in range(2):
        lines = list(reproduce_trial(campaign, tmp_path / "out", trial.key[:9]))
    assert lines[0] == f"{trial.key}: default, move, seed 2"
    assert lines[-1] == "equal to the stored result, bit by bit"
    recording = Recording.open(tmp_path / "out" / "trials" / trial.key)
    assert sum(1 for _ in recording.steps()) > 10
    with pytest.raises(UsageError, match="--trial : 4 trials have this key; expected one key, such as"):
        list(reproduce_trial(campaign, tmp_path / "out", ""))


def test_a_controller_that_reads_a_clock_is_found(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, seeds=1, programs=("clock",))
    run_campaign(campaign, tmp_path / "out", InProcess)
    with pytest.raises(CampaignError, match=r"differs from the stored result in .*; a controller uses"):
        list(reproduce_trial(campaign, tmp_path / "out", campaign.trials[0].key))


def test_a_failed_trial_is_reproduced_as_a_failure(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, seeds=1, programs=("bad",))
    run_campaign(campaign, tmp_path / "out", InProcess)
    with pytest.raises(CampaignError, match="the trial failed: ZeroDivisionError"):
        list(reproduce_trial(campaign, tmp_path / "out", campaign.trials[0].key))


def test_the_manifest_is_plain_json(tmp_path: Path) -> None:
    campaign = small_campaign(tmp_path, more=CLAIMS)
    text = json.dumps(campaign.manifest)
    assert "claims" not in json.loads(text)["campaign"]
    assert re.search(r'"odd:move": "[0-9a-f]{64}"', text)
