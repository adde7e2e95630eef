"""YAML file of an experiment: small strict models; errors name file and line."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, TypeAdapter, ValidationError

from armgate.cell.config.fields import ConfigModel, Duration, Length, Name, Period, Size, Speed
from armgate.cell.config.validation_errors import to_config_error
from armgate.cell.config.yaml_tree import read_tree

Point = tuple[Length, Length, Length]
Seeds = Annotated[int, Field(ge=1, le=10_000)]
Share = Annotated[float, Field(gt=0.0, lt=1.0)]
Lag = Annotated[Duration, Field(ge=0.0)]


class Box(ConfigModel):
    """Region of the leader's tool: centre and half sides, world, m."""

    middle: Point
    half: Point


class Common(ConfigModel):
    """Fields of all experiments.

    Attributes:
        armgate: Version of the format.
        seeds: Number of leader paths or starts.
        first_seed: First seed; the others follow it.
        seconds: Length of a run.
        distance: Wanted view distance.
    """

    armgate: Literal[1]
    seeds: Seeds
    first_seed: Annotated[int, Field(ge=0)] = 0
    seconds: Period
    distance: Size = 1.0


class Approach(Common):
    """Experiment in which the leader rests, and the follower starts far from the optimum or at a joint limit.

    Attributes:
        limit_share: Share of the half range at which a joint starts if it starts at its limit.
        lag: Lag of the robots.
    """

    experiment: Literal["approach"]
    lag: Lag = 0.0
    limit_share: Share = 0.999


class TrackingCase(ConfigModel):
    """Case of following: the leader's largest speed, the robots' lag, with or without prediction."""

    name: Name
    speed: Speed
    lag: Lag
    predict: bool


class Tracking(Common):
    """Experiment in which the leader moves as driven by a joystick."""

    experiment: Literal["tracking"]
    box: Box
    cases: Annotated[tuple[TrackingCase, ...], Field(min_length=1)]


class Zoom(Common):
    """Experiment like tracking, in which an operator also changes the wanted distance."""

    experiment: Literal["zoom"]
    box: Box
    speed: Speed
    lag: Lag
    low: Size
    high: Size
    rate: Speed


class Pursuit(ConfigModel):
    """Pursuit of a follower's link by the leader: number of seeds, duration, speeds."""

    seeds: Seeds
    seconds: Period
    speeds: Annotated[tuple[Speed, ...], Field(min_length=1)]


class Collision(Common):
    """Experiment in which the leader moves straight at the follower (dash), or pursues it."""

    experiment: Literal["collision"]
    focus: Point
    way: Size
    speeds: Annotated[tuple[Speed, ...], Field(min_length=1)]
    lag: Lag
    pursuit: Pursuit | None = None


Experiment = Approach | Tracking | Zoom | Collision
_KINDS: dict[str, type[Experiment]] = {
    "approach": Approach, "tracking": Tracking, "zoom": Zoom, "collision": Collision,
}  # fmt: skip


def load_experiment(path: Path) -> Experiment:
    """Read an experiment's file.

    Raises:
        ConfigError: The file cannot be read or is malformed; the text names file, line and key.
    """
    tree = read_tree([path])
    plain = tree.plain()
    kind = plain.get("experiment") if isinstance(plain, dict) else None
    model = _KINDS.get(kind, Head) if isinstance(kind, str) else Head
    try:
        return TypeAdapter(model).validate_python(plain)  # type: ignore[return-value]
    except ValidationError as error:
        raise to_config_error(error, tree, model) from error


class Head(ConfigModel):
    """Head of the file, checked if the kind of the experiment is unknown."""

    experiment: Literal["approach", "tracking", "zoom", "collision"]
