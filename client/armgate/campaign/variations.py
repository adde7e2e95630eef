"""Application of fixed and drawn values to the configuration of a cell and to controllers."""

from collections.abc import Iterable, Mapping
from typing import Any

from pydantic import ValidationError

from armgate.campaign.campaign_file import CampaignConfig, ControllerConfig, ScenarioConfig
from armgate.campaign.distributions import Variation
from armgate.cell.config.validation_errors import to_config_error
from armgate.cell.config.yaml_tree import KeyPath, Node, dotted, read_tree

CELL, CONTROLLERS = "cell", "controllers"


def variations(campaign: CampaignConfig, scenario: ScenarioConfig) -> dict[str, Variation]:
    """Return the varied keys of a scenario in alphabetical order; a key that the scenario sets is fixed."""
    merged = campaign.vary | scenario.vary
    return {key: merged[key] for key in sorted(merged) if key not in scenario.set}


def place_of(campaign: CampaignConfig, name: str, key: str) -> KeyPath:
    """Return the place in the file of the campaign of a scenario's value or distribution of a key."""
    scenario = campaign.scenarios[name]
    if key in scenario.set:
        return ("scenarios", name, "set", key)
    return ("scenarios", name, "vary", key) if key in scenario.vary else ("vary", key)


def cell_tree(campaign: CampaignConfig, name: str) -> Node:
    """Return the configuration of a scenario's cell, with its fixed values.

    Raises:
        ConfigError: A file cannot be read, or a key has no place in the configuration.
    """
    scenario = campaign.scenarios[name]
    tree = read_tree([campaign.folder / file for file in (*campaign.cell, *scenario.cell)])
    return with_values(campaign, name, tree, scenario.set)


def with_values(campaign: CampaignConfig, name: str, tree: Node, values: Mapping[str, Any]) -> Node:
    """Return the configuration with the values of keys that begin with ``cell.``; others are ignored.

    Raises:
        ConfigError: A key has no place in the configuration.
    """
    for key, value in values.items():
        first, _, rest = key.partition(".")
        if first == CELL:
            node = campaign.node(place_of(campaign, name, key), value)
            tree = tree.replaced(_path(tree, rest), node)
    return tree


def varies_cell(values: Iterable[str]) -> bool:
    """Return True if one of these keys belongs to the configuration of the cell."""
    return any(key.partition(".")[0] == CELL for key in values)


def controllers_with(
    campaign: CampaignConfig, scenario: str, name: str, values: Mapping[str, Any]
) -> dict[str, ControllerConfig]:
    """Return a set of controllers with the values of keys that begin with ``controllers.``.

    Raises:
        ConfigError: A value does not fit its key.
    """
    found = dict(campaign.controllers[name])
    for key, value in values.items():
        first, participant, path = _split(key)
        if first == CONTROLLERS and participant in found:
            where = place_of(campaign, scenario, key)
            found[participant] = _changed(campaign, found[participant], where, path, value)
    return found


def _split(key: str) -> tuple[str, str, KeyPath]:
    first, _, rest = key.partition(".")
    participant, _, path = rest.partition(".")
    return first, participant, tuple(path.split(".")) if path else ()


def _changed(
    campaign: CampaignConfig, controller: ControllerConfig, where: KeyPath, path: KeyPath, value: Any
) -> ControllerConfig:
    tree = campaign.node(where, controller.model_dump(exclude_unset=True))
    changed = tree.replaced(path, campaign.node(where, value))
    try:
        return ControllerConfig.model_validate(changed.plain())
    except ValidationError as error:
        raise to_config_error(error, changed, ControllerConfig) from error


def _path(tree: Node, rest: str) -> KeyPath:
    """Return the keys in a dotted text. A key of the tree may itself have dots: the longest one counts."""
    found: list[str | int] = []
    node: Node | None = tree
    while rest:
        step, rest = _step(node, rest)
        found.append(step)
        node = _child(node, step)
    return tuple(found)


def _step(node: Node | None, rest: str) -> tuple[str | int, str]:
    if node is not None and isinstance(node.value, dict):
        fits = [key for key in node.value if rest == key or rest.startswith(f"{key}.")]
        if fits:
            key = max(fits, key=len)
            return key, rest[len(key) + 1 :]
    step, _, rest = rest.partition(".")
    is_list = node is not None and isinstance(node.value, tuple)
    return int(step) if is_list and step.isdecimal() else step, rest


def _child(node: Node | None, step: str | int) -> Node | None:
    if node is None:
        return None
    if isinstance(node.value, dict):
        return node.value.get(str(step))
    if isinstance(node.value, tuple) and isinstance(step, int) and step < len(node.value):
        return node.value[step]
    return None


def check_keys(campaign: CampaignConfig) -> None:
    """Check that keys of controllers name participants, and that no scenario sets and varies one key.

    Raises:
        ConfigError: A key has no effect, or two values.
    """
    participants = {name for controllers in campaign.controllers.values() for name in controllers}
    for name, scenario in campaign.scenarios.items():
        if both := sorted(scenario.set.keys() & scenario.vary.keys()):
            raise campaign.error(
                ("scenarios", name, "vary", both[0]), "the scenario also sets this key; expected one of both"
            )
        for key in scenario.set | variations(campaign, scenario):
            _check_participant(campaign, place_of(campaign, name, key), key, participants)


def _check_participant(campaign: CampaignConfig, where: KeyPath, key: str, participants: set[str]) -> None:
    first, participant, path = _split(key)
    if first != CONTROLLERS:
        return
    if participant not in participants:
        known = ", ".join(sorted(participants))
        raise campaign.error(where, f"there is no participant {participant!r}; expected one of {known}")
    if not path or path[0] not in ("options", "delay", "jitter"):
        raise campaign.error(
            where, f"{dotted(path) or 'the whole controller'}; expected options.NAME, delay or jitter"
        )
