"""Trials of a campaign: every scenario with every set of controllers and every seed; keys of results."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from armgate.campaign.campaign_file import CampaignConfig
from armgate.campaign.distributions import Value, generator
from armgate.campaign.variations import controllers_with, variations

KEY_DIGITS = 16
"""Length of a key: 64 bits of a SHA-256."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One trial.

    Attributes:
        key: Hash of everything that determines its figures.
        scenario: Name of the scenario.
        controllers: Name of the set of controllers.
        seed: Seed of all its random values.
        values: Drawn values by key.
    """

    key: str
    scenario: str
    controllers: str
    seed: int
    values: tuple[tuple[str, Value], ...]


@dataclass(frozen=True, slots=True)
class Basis:
    """Everything besides the file of the campaign that determines the results.

    Attributes:
        versions: Versions of armgate and of the libraries that compute.
        sources: SHA-256 of the file of each Python entry.
        cells: Hash of the cell of each scenario, with its fixed values.
    """

    versions: Mapping[str, str]
    sources: Mapping[str, str]
    cells: Mapping[str, str]


def trials(campaign: CampaignConfig, basis: Basis) -> list[Trial]:
    """Return all trials, seed by seed.

    Raises:
        ConfigError: A drawn value does not fit its key.
    """
    return list(_trials(campaign, basis))


def _trials(campaign: CampaignConfig, basis: Basis) -> Iterator[Trial]:
    common = _Common(campaign, basis)
    for seed in range(campaign.first_seed, campaign.first_seed + campaign.seeds):
        for scenario, config in campaign.scenarios.items():
            varied = variations(campaign, config)
            values = {key: one.draw(generator(seed, key)) for key, one in varied.items()}
            for controllers in campaign.controllers:
                key = common.key(scenario, controllers, seed, values)
                yield Trial(key, scenario, controllers, seed, tuple(values.items()))


class _Common:
    """Hashes of the data that the trials of a scenario and a set of controllers share."""

    def __init__(self, campaign: CampaignConfig, basis: Basis) -> None:
        self._shared = {
            (scenario, name): hashlib.sha256(_shared(campaign, basis, scenario, name))
            for scenario in campaign.scenarios
            for name in campaign.controllers
        }

    def key(self, scenario: str, controllers: str, seed: int, values: Mapping[str, Value]) -> str:
        """Return the key of a trial."""
        digest = self._shared[scenario, controllers].copy()
        digest.update(canonical({"seed": seed, "values": values}))
        return digest.hexdigest()[:KEY_DIGITS]


def _shared(campaign: CampaignConfig, basis: Basis, scenario: str, name: str) -> bytes:
    config = campaign.scenarios[scenario]
    fixed = controllers_with(campaign, scenario, name, config.set)
    return canonical(
        {
            "format": campaign.armgate,
            "versions": basis.versions,
            "sources": basis.sources,
            "scenario": scenario,
            "cell": basis.cells[scenario],
            "controllers": [[who, one.model_dump(mode="json")] for who, one in fixed.items()],
            "name": name,
            "duration": campaign.duration if config.duration is None else config.duration,
            "until": campaign.until,
            "figures": {key: one.model_dump(mode="json") for key, one in campaign.figures.items()},
        }
    )


def canonical(value: Any) -> bytes:
    """Return JSON of a value that does not depend on the order of keys; numbers are exact."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False).encode() + b"\n"
