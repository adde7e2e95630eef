"""YAML file of a campaign: strict models; errors name file, line and key."""

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, Field, PrivateAttr, ValidationError, model_validator

from armgate.campaign.distributions import Number, Plain, Variation
from armgate.cell.config.fields import ConfigModel, Duration, Name, Period
from armgate.cell.config.validation_errors import to_config_error
from armgate.cell.config.yaml_tree import KeyPath, Node, config_error, read_tree
from armgate.cell.errors import ConfigError

MOST_TRIALS = 1_000_000
"""Largest number of trials; the driver holds the results of all of them (about 2 kB each)."""


def _matching(pattern: str, expected: str) -> Callable[[str], str]:
    def checked(text: str) -> str:
        if re.fullmatch(pattern, text) is None:
            raise ValueError(f"{text!r}; expected {expected}")
        return text

    return checked


Entry = Annotated[str, AfterValidator(_matching(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*", "package.module:function"))]
"""Python entry, ``package.module:function``."""
Delay = Annotated[Duration, Field(ge=0.0)]
"""Time, s, of 0 or more."""
Key = Annotated[str, AfterValidator(_matching(r"(cell|controllers)\..+", "cell.… or controllers.…"))]
"""Varied key: of the cell's configuration, or of a controller."""
Text = Annotated[str, AfterValidator(_matching(r".{1,200}", "one line of 1 to 200 characters"))]
"""One line for people."""


class ControllerConfig(ConfigModel):
    """Controller of one participant: a program in Python, or a command that speaks the protocol."""

    program: Entry | None = None
    """Entry that makes a program, ``package.module:make``."""
    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    """Command and arguments; ``{address}``, ``{name}``, ``{robot}``, ``{seed}``, options are filled in."""
    robot: Name | None = None
    """Robot that it commands; absent: the robot with the name of the participant, if there is one."""
    options: dict[str, Plain] = {}
    """Options of the program or of the command."""
    delay: Delay = 0.0
    """Time by which the increments of a program are late, rounded to ticks [s]."""
    jitter: Delay = 0.0
    """Largest additional time by which they are late, uniformly distributed for each tick [s]."""

    @model_validator(mode="after")
    def _one_kind(self) -> Self:
        if (self.program is None) == (self.command is None):
            raise ValueError("expected one of program and command")
        if self.command is not None and (self.delay or self.jitter):
            raise ValueError("delay and jitter of a command; expected a program")
        return self

    def robot_in(self, robots: Iterable[str], participant: str) -> str | None:
        """Return its robot in a cell with these robots; None if it commands none."""
        if self.robot is not None:
            return self.robot
        return participant if participant in robots else None


class ScenarioConfig(ConfigModel):
    """Scenario: changes to the cell and to the campaign."""

    cell: tuple[str, ...] = ()
    """Files that overlay the campaign's cell."""
    set: dict[Key, Any] = {}
    """Fixed values of keys."""
    vary: dict[Key, Variation] = {}
    """Distributions of keys, in addition to the campaign's."""
    duration: Period | None = None
    """Longest duration of a trial, in place of the campaign's [s]."""


class FigureConfig(ConfigModel):
    """Figure of a trial that a Python function computes."""

    function: Entry
    """Entry of the function, ``package.module:function``."""
    options: dict[str, Plain] = {}
    """Keyword arguments of the function."""
    unit: str = ""
    """Unit of the figure."""


_AGGREGATES = r"min|max|mean|median|sum|share|p\d{1,2}(\.\d+)?"
Aggregate = Annotated[
    str, AfterValidator(_matching(_AGGREGATES, "min, max, mean, median, sum, share or p0 to p99.9"))
]
"""Aggregate of a figure over trials; ``share`` is the share of trials in which it is not 0."""


class ClaimConfig(ConfigModel):
    """Claim: an aggregate of a figure, compared with a goal."""

    claim: Text
    """The claim in words."""
    figure: str
    """Figure of a trial, ``failed`` included."""
    aggregate: Aggregate
    """Combination of the figures of the trials."""
    at_most: Number | None = None
    """Goal: the largest value."""
    at_least: Number | None = None
    """Goal: the smallest value."""
    compared_with: Name | None = None
    """Controllers whose value multiplies the goal: ``at_most: 0.5`` is then half of their value."""
    scenarios: tuple[Name, ...] = ()
    """Scenarios that count; absent: all."""
    controllers: tuple[Name, ...] = ()
    """Controllers that count; absent: all except those of ``compared_with``."""

    @model_validator(mode="after")
    def _one_goal(self) -> Self:
        if (self.at_most is None) == (self.at_least is None):
            raise ValueError("expected one of at_most and at_least")
        return self


Controllers = Annotated[dict[Name, ControllerConfig], Field(min_length=1)]
"""Controllers of one trial by participant, in the order in which they join."""


class CampaignConfig(ConfigModel):
    """Campaign: scenarios × controllers × seeds, figures and claims."""

    armgate: Literal[1]
    """Version of the format: 1."""
    name: Name
    """Name of the campaign."""
    cell: Annotated[tuple[str, ...], Field(min_length=1)]
    """Configuration of the cell, relative to this file; later files overlay earlier ones."""
    duration: Period
    """Longest duration of a trial, virtual time [s]."""
    until: tuple[Name, ...] = ()
    """Participants whose end ends the trial; absent: all."""
    seeds: Annotated[int, Field(ge=1, le=10_000_000)]
    """Number of seeds."""
    first_seed: Annotated[int, Field(ge=0, le=2**62)] = 0
    """First seed; the others follow it."""
    timeout: Annotated[Period, Field(le=86_400.0)] = 600.0
    """Longest time for which one trial may run on a worker [s]."""
    attempts: Annotated[int, Field(ge=1, le=100)] = 3
    """Attempts of a trial whose worker ends."""
    scenarios: Annotated[dict[Name, ScenarioConfig], Field(min_length=1)] = {"default": ScenarioConfig()}
    """Scenarios by name; absent: one, ``default``, without changes."""
    controllers: Annotated[dict[Name, Controllers], Field(min_length=1)]
    """Sets of controllers by name; each trial runs one set."""
    vary: dict[Key, Variation] = {}
    """Distributions of keys, for all scenarios."""
    figures: dict[Name, FigureConfig] = {}
    """Own figures by name."""
    claims: tuple[ClaimConfig, ...] = ()
    """Claims of the campaign."""

    _tree: Node | None = PrivateAttr(default=None)
    _file: Path = PrivateAttr(default=Path())

    @property
    def file(self) -> Path:
        """File of the campaign."""
        return self._file

    @property
    def folder(self) -> Path:
        """Folder of the file: paths start here, and Python entries may be modules in it."""
        return self._file.parent

    def error(self, path: KeyPath, text: str) -> ConfigError:
        """Return an error about the value under these keys."""
        return config_error(None if self._tree is None else self._tree.locate(path), path, text)

    def node(self, path: KeyPath, value: object) -> Node:
        """Return a tree of a plain value whose marks are the place of the value under these keys."""
        assert self._tree is not None
        return _marked(value, self._tree.locate(path))


def load_campaign(path: Path) -> CampaignConfig:
    """Read the file of a campaign.

    Raises:
        ConfigError: The file cannot be read or is malformed; the text names file, line and key.
    """
    tree = read_tree([path])
    try:
        campaign = CampaignConfig.model_validate(tree.plain())
    except ValidationError as error:
        raise to_config_error(error, tree, CampaignConfig) from error
    campaign._tree, campaign._file = tree, path
    _check_names(campaign)
    _check_size(campaign)
    return campaign


def _marked(value: Any, mark: Any) -> Node:
    if isinstance(value, Mapping):
        return Node({key: _marked(one, mark) for key, one in value.items()}, mark, dict.fromkeys(value, mark))
    if isinstance(value, list | tuple):
        return Node(tuple(_marked(one, mark) for one in value), mark)
    return Node(value, mark)


def _check_size(campaign: CampaignConfig) -> None:
    count = campaign.seeds * len(campaign.scenarios) * len(campaign.controllers)
    if count > MOST_TRIALS:
        raise campaign.error(("seeds",), f"{count} trials in all; expected at most {MOST_TRIALS}")


def _check_names(campaign: CampaignConfig) -> None:
    """Check that claims and ``until`` name scenarios, controllers and participants of the campaign."""
    participants = {name for controllers in campaign.controllers.values() for name in controllers}
    _known(campaign, ("until",), campaign.until, participants)
    for at, claim in enumerate(campaign.claims):
        _known(campaign, ("claims", at, "scenarios"), claim.scenarios, campaign.scenarios)
        _known(campaign, ("claims", at, "controllers"), claim.controllers, campaign.controllers)
        if claim.compared_with is not None:
            where: KeyPath = ("claims", at, "compared_with")
            _known(campaign, where, (claim.compared_with,), campaign.controllers)


def _known(campaign: CampaignConfig, path: KeyPath, names: tuple[str, ...], known: Any) -> None:
    for name in names:
        if name not in known:
            raise campaign.error(path, f"there is no {name!r}; expected one of {', '.join(sorted(known))}")
