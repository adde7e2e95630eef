"""An experiment as its YAML file tells it: small strict models; errors name file and line."""

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
    """Where the leader's tool works: middle and half sides, world, m."""

    middle: Point
    half: Point


class Common(ConfigModel):
    """What all experiments have.

    Attributes:
        armgate: Version of this form.
        seeds: How many leader paths or starts.
        first_seed: The first seed; the others follow.
        seconds: How long a run is.
        distance: Wanted view distance.
    """

    armgate: Literal[1]
    seeds: Seeds
    first_seed: Annotated[int, Field(ge=0)] = 0
    seconds: Period
    distance: Size = 1.0


class Approach(Common):
    """The leader rests; the follower starts far off, or at a limit of a joint.

    Attributes:
        limit_share: Where in its half range a joint is in the starts at limits.
        lag: Of the robots.
    """

    experiment: Literal["approach"]
    lag: Lag = 0.0
    limit_share: Share = 0.999


class TrackingCase(ConfigModel):
    """One way of following: the leader's largest speed, the robots' lag, with prediction or without."""

    name: Name
    speed: Speed
    lag: Lag
    predict: bool


class Tracking(Common):
    """The leader goes around as with a joystick."""

    experiment: Literal["tracking"]
    box: Box
    cases: Annotated[tuple[TrackingCase, ...], Field(min_length=1)]


class Zoom(Common):
    """The same while an operator changes the wanted distance."""

    experiment: Literal["zoom"]
    box: Box
    speed: Speed
    lag: Lag
    low: Size
    high: Size
    rate: Speed


class Pursuit(ConfigModel):
    """The leader goes for a link of the follower wherever that moves to: how often, how long, how fast."""

    seeds: Seeds
    seconds: Period
    speeds: Annotated[tuple[Speed, ...], Field(min_length=1)]


class Collision(Common):
    """The leader dashes at the follower, whose focus stays; then it pursues it, where that is asked for."""

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
    """Reads an experiment's file.

    Raises:
        ConfigError: It cannot be read or is not what was expected; the text names file, line and key.
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
    """What tells which experiment it is; asked where that cannot be told."""

    experiment: Literal["approach", "tracking", "zoom", "collision"]
