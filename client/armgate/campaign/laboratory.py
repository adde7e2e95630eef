"""Laboratory: runs the trials of one campaign in this process, and keeps their shared data."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from armgate.campaign.basis import versions
from armgate.campaign.campaign_file import CampaignConfig, ControllerConfig
from armgate.campaign.commands import Command, run_with_daemon
from armgate.campaign.distributions import seed_of
from armgate.campaign.entries import load_entry
from armgate.campaign.errors import CampaignError
from armgate.campaign.figures import compute, load_functions
from armgate.campaign.late import LateProgram
from armgate.campaign.result import Result, failed
from armgate.campaign.series import Series
from armgate.campaign.trials import Basis, Trial
from armgate.campaign.variations import cell_tree, controllers_with, varies_cell, with_values
from armgate.cell.cell import Cell, build_cell
from armgate.cell.config import config_of
from armgate.cell.config.yaml_tree import Node
from armgate.cell.errors import CellError
from armgate.client.program import Program, ProgramContext
from armgate.programs import Controller, run
from armgate.recorder import WorldRecorder
from armgate.world import World
from armgate.world.run_recorders import RunRecorder


class WorkerError(CampaignError):
    """Difference between this machine and the one that started the campaign."""


class TrialError(Exception):
    """Controller that failed in a trial."""


class Laboratory:
    """Runner of the trials of one campaign.

    Args:
        campaign: The campaign.
        basis: Data on which the keys of the trials depend.

    Raises:
        WorkerError: Versions on this machine differ from the basis.
        EntryError: A Python entry cannot be imported.
    """

    def __init__(self, campaign: CampaignConfig, basis: Basis) -> None:
        self._campaign, self._basis = campaign, basis
        _check("versions", versions(), basis.versions)
        self._functions = load_functions(campaign.figures, campaign.folder)
        self._makers = _makers(campaign)
        self._scenarios: dict[str, tuple[Node, Cell]] = {}

    def run(self, trial: Trial, recording: Path | None = None) -> Result:
        """Run a trial.

        Args:
            trial: The trial.
            recording: Folder for its recording; None: no recording.

        Returns:
            Its result; an error of the controllers or of drawn values is a failed trial.

        Raises:
            WorkerError: The cell on this machine is not the one of the campaign.
        """
        self._scenario(trial.scenario)
        try:
            series = self._series(trial, recording)
            return Result(trial.key, figures=compute(series, self._campaign.figures, self._functions))
        except (Exception, SystemExit) as error:
            return failed(trial.key, error)

    def cell(self, trial: Trial) -> Cell:
        """Return the cell of a trial.

        Raises:
            ConfigError: A drawn value does not fit its key.
        """
        tree, cell = self._scenario(trial.scenario)
        values = dict(trial.values)
        if not varies_cell(values):
            return cell
        return build_cell(config_of(with_values(self._campaign, trial.scenario, tree, values)))

    def _scenario(self, name: str) -> tuple[Node, Cell]:
        if name not in self._scenarios:
            tree, cell = self._read(name)
            _check(f"cell of the scenario {name}", {"hash": cell.hash}, {"hash": self._basis.cells[name]})
            self._scenarios[name] = tree, cell
        return self._scenarios[name]

    def _read(self, name: str) -> tuple[Node, Cell]:
        try:
            tree = cell_tree(self._campaign, name)
            return tree, build_cell(config_of(tree))
        except (CellError, OSError) as error:
            raise WorkerError(f"the cell of the scenario {name} cannot be read here: {error}") from error

    def _series(self, trial: Trial, recording: Path | None) -> Series:
        cell = self.cell(trial)
        scenario = self._campaign.scenarios[trial.scenario]
        values = scenario.set | dict(trial.values)
        controllers = controllers_with(self._campaign, trial.scenario, trial.controllers, values)
        duration = self._campaign.duration if scenario.duration is None else scenario.duration
        until = tuple(name for name in self._campaign.until if name in controllers)
        members = self._members(cell, controllers, trial.seed)
        if any(isinstance(member, Command) for member in members.values()):
            return run_with_daemon(cell.config, members, duration, until, recording)
        programs = {name: member for name, member in members.items() if isinstance(member, Controller)}
        return _in_world(cell, programs, duration, until, recording)

    def _members(
        self, cell: Cell, controllers: Mapping[str, ControllerConfig], seed: int
    ) -> dict[str, Command | Controller]:
        found: dict[str, Command | Controller] = {}
        for name, controller in controllers.items():
            robot = controller.robot_in([robot.name for robot in cell.robots], name)
            own = seed_of(seed, f"participant {name}")
            period = None if robot is None else cell.robot(robot).period
            if controller.command is None:
                found[name] = Controller(self._maker(controller, period, own), robot, seed=own)
            else:
                found[name] = Command(_words(controller, robot, own), robot)
        return found

    def _maker(
        self, controller: ControllerConfig, period: float | None, seed: int
    ) -> Callable[[ProgramContext], Program]:
        """Return a function that makes the program of a controller; ``period`` is that of its robot, s."""
        assert controller.program is not None
        make = self._makers[controller.program]

        def made(context: ProgramContext) -> Program:
            program: Program = make(context, **controller.options)
            if period is None or not (controller.delay or controller.jitter):
                return program
            return LateProgram(program, period, controller.delay, controller.jitter, seed)

        return made


def _words(controller: ControllerConfig, robot: str | None, seed: int) -> tuple[str, ...]:
    """Return the words of a command with robot, seed and options; address and name follow at its start."""
    values = {"robot": robot or "", "seed": seed} | controller.options

    def filled(word: str) -> str:
        for key, value in values.items():
            word = word.replace(f"{{{key}}}", str(value))
        return word

    return tuple(map(filled, controller.command or ()))


def _in_world(
    cell: Cell,
    programs: Mapping[str, Controller],
    duration: float,
    until: tuple[str, ...],
    recording: Path | None,
) -> Series:
    series = Series()
    recorder = None if recording is None else WorldRecorder(recording)
    recorders: Sequence[RunRecorder] = [series] if recorder is None else [series, recorder]
    try:
        world = World(cell, tuple(programs), recorders=recorders)
        outcomes = run(world, programs, until=until, seconds=duration)
    finally:
        if recorder is not None:
            recorder.close()
    for name, outcome in outcomes.items():
        if outcome is not None and outcome.failed:
            raise TrialError(f"{name}: {outcome.text}")
    return series


def _makers(campaign: CampaignConfig) -> dict[str, Callable[..., Any]]:
    entries = {one.program for controllers in campaign.controllers.values() for one in controllers.values()}
    return {entry: load_entry(entry, campaign.folder) for entry in entries if entry is not None}


def _check(what: str, here: Mapping[str, str], expected: Mapping[str, str]) -> None:
    for name, value in expected.items():
        if here.get(name) != value:
            raise WorkerError(
                f"{what}: {name} is {here.get(name, 'missing')} on this worker; the campaign has {value}; "
                "give all machines the same software and files"
            )
