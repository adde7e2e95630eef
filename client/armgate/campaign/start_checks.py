"""Checks of a campaign against its cells and Python entries, so that a mistake is one error before any trial.

Values that are drawn can be invalid in a few trials, which then fail. If none of the first draws of a
scenario is valid, the file is wrong.
"""

import inspect
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any

from armgate.campaign.campaign_file import CampaignConfig, ControllerConfig
from armgate.campaign.entries import load_entry
from armgate.campaign.trials import Trial
from armgate.campaign.variations import controllers_with, variations, varies_cell, with_values
from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import config_of
from armgate.cell.config.yaml_tree import KeyPath, Node
from armgate.cell.errors import ConfigError
from armgate.links.kind import check_stepped

DRAWS = 10
"""Number of trials of a scenario whose drawn values are tried."""


def check_start(
    campaign: CampaignConfig,
    trees: Mapping[str, Node],
    cells: Mapping[str, Cell],
    trials: Iterable[Trial],
) -> None:
    """Check everything that would make each trial of a scenario or of a set of controllers fail.

    Args:
        campaign: The campaign.
        trees: Configuration of each scenario's cell.
        cells: Cell of each scenario.
        trials: All trials, seed by seed.

    Raises:
        ConfigError: A link is not emulated; a robot, option, command or varied key does not exist; or the
            drawn values are not valid.
    """
    _check_figures(campaign)
    for cell in cells.values():
        check_stepped(cell)
    for own in _first_trials(trials).values():
        name = own[0].scenario
        _one_valid(own, partial(_check_cell, campaign, trees[name]))
        _one_valid(own, partial(_check_controllers, campaign, cells[name]))


def _first_trials(trials: Iterable[Trial]) -> dict[tuple[str, str], list[Trial]]:
    """Return the first trials of each scenario and set of controllers."""
    found: dict[tuple[str, str], list[Trial]] = {}
    for trial in trials:
        own = found.setdefault((trial.scenario, trial.controllers), [])
        if len(own) == DRAWS:
            break  # seed by seed: all others have as many
        own.append(trial)
    return found


def _one_valid(trials: Sequence[Trial], check: Callable[[Trial], object]) -> None:
    """Check trials until one is valid; raise the error of the last one if there is no valid one."""
    for trial in trials:
        try:
            check(trial)
        except ConfigError:
            if trial is trials[-1]:
                raise
        else:
            return


def _check_cell(campaign: CampaignConfig, tree: Node, trial: Trial) -> None:
    """Check the configuration with the drawn values of a trial, which have the units of the file."""
    varied = variations(campaign, campaign.scenarios[trial.scenario])
    values = {key: varied[key].with_unit(value) for key, value in trial.values}
    if varies_cell(values):
        build_cell(config_of(with_values(campaign, trial.scenario, tree, values)))


def _check_controllers(campaign: CampaignConfig, cell: Cell, trial: Trial) -> None:
    values = campaign.scenarios[trial.scenario].set | dict(trial.values)
    commanded: dict[str, str] = {}
    for name, controller in controllers_with(campaign, trial.scenario, trial.controllers, values).items():
        where: KeyPath = ("controllers", trial.controllers, name)
        robot = _robot(campaign, where, controller, cell)
        if robot in commanded:
            raise campaign.error(where, f"{commanded[robot]} commands {robot}, too; expected one controller")
        if robot is not None:
            commanded[robot] = name
        elif controller.delay or controller.jitter:
            raise campaign.error(where, "delay or jitter without a robot; expected the key 'robot'")
        _check_program(campaign, where, controller)


def _robot(campaign: CampaignConfig, where: KeyPath, controller: ControllerConfig, cell: Cell) -> str | None:
    names = [robot.name for robot in cell.robots]
    robot = controller.robot_in(names, str(where[-1]))
    if robot is not None and robot not in names:
        text = f"there is no robot {robot!r}; expected one of {', '.join(names)}"
        raise campaign.error((*where, "robot"), text)
    return robot


def _check_program(campaign: CampaignConfig, where: KeyPath, controller: ControllerConfig) -> None:
    if controller.program is not None:
        _check_options(campaign, where, controller.program, controller.options)
    elif controller.command is not None:
        word = controller.command[0]
        if word != "armgate" and "{" not in word and shutil.which(word) is None:
            raise campaign.error((*where, "command"), f"{word}: there is no such command on this machine")


def _check_figures(campaign: CampaignConfig) -> None:
    for name, figure in campaign.figures.items():
        _check_options(campaign, ("figures", name), figure.function, figure.options)


def _check_options(campaign: CampaignConfig, where: KeyPath, entry: str, options: Mapping[str, Any]) -> None:
    """Check that a function of the campaign takes these options after its first argument."""
    try:
        signature = inspect.signature(load_entry(entry, campaign.folder))
    except ValueError:  # a function without a signature that Python knows
        return
    try:
        signature.bind(None, **options)
    except TypeError as error:
        raise campaign.error((*where, "options"), f"{entry}{signature}: {error}") from error
