"""The example of docs/campaigns.md runs, and the page names every key, figure and entry."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from armgate.campaign.campaign_file import (
    CampaignConfig,
    ClaimConfig,
    ControllerConfig,
    FigureConfig,
    ScenarioConfig,
)
from armgate.campaign.distributions import Variation
from armgate.campaign.entries import load_entry
from armgate.campaign.figures import ROBOT_UNITS, UNITS
from armgate.campaign.store import read_results

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "campaigns.md").read_text(encoding="utf-8")


def block(language: str) -> str:
    """Return the first block of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[0]


def armgate(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "armgate.apps", "campaign", "nudge.yaml", "--out", "runs/nudge", *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=300)


def test_the_first_campaign_runs_and_a_trial_is_reproduced(tmp_path: Path) -> None:
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    (tmp_path / "nudge.py").write_text(block("python"))
    text = block("yaml")
    (tmp_path / "nudge.yaml").write_text(text.replace("seeds: 4", "seeds: 1"))
    assert "seeds: 4" in text
    done = armgate(tmp_path, "--jobs", "1")
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.count("holds") == 2
    assert "4/4" in done.stdout
    folder = tmp_path / "runs" / "nudge"
    assert {"results.parquet", "report.html", "campaign.json"} <= {path.name for path in folder.iterdir()}
    results = read_results(folder)
    assert max(result.figures["end"] for result in results.values()) > 0.5
    key = min(results)
    again = armgate(tmp_path, "--trial", key[:8])
    assert again.returncode == 0, again.stderr
    assert again.stdout.splitlines()[-1] == "equal to the stored result, bit by bit"
    assert list((folder / "trials" / key).glob("*.mcap"))


@pytest.mark.parametrize(
    "model", [CampaignConfig, ScenarioConfig, ControllerConfig, FigureConfig, ClaimConfig, Variation]
)
def test_every_key_is_on_the_page(model: type) -> None:
    tables = "\n".join(line.split("|")[1] for line in PAGE.splitlines() if line.startswith("|"))
    named = set(re.findall(r"`\{?(\w+)", tables))
    assert set(model.model_fields) <= named  # type: ignore[attr-defined]


def test_every_figure_is_on_the_page() -> None:
    section = PAGE.partition("## Figures")[2].partition("\n## ")[0]
    named = set(re.findall(r"`(?:ROBOT\.)?(\w+)`", section))
    assert {*UNITS, *ROBOT_UNITS, "failed"} <= named


def test_the_named_entries_exist() -> None:
    entries = re.findall(r"`(armgate\.[\w.]+:\w+)`", PAGE)
    assert len(entries) == 7
    for entry in entries:
        load_entry(entry, ROOT)
