"""Reference of the command line, from the signatures and docstrings of the registered commands."""

import inspect
import re
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import typer
from typer.models import ArgumentInfo, OptionInfo

from armgate.apps.cli import GROUP
from tools.reference.own import own_entry_points
from tools.reference.table import prose, table

HEAD = """\
# Command line

<!-- Written by `make reference` from the code. -->

`armgate COMMAND --help` prints the same. `armgate --version` prints the version.

Exit status of every command: 0 done, 1 failed, 2 called wrongly (options, configuration, files).
"""
_PLACEHOLDERS = {str: "TEXT", int: "INTEGER", float: "NUMBER", Path: "PATH"}

Command = Callable[..., Any]


def command_line() -> str:
    """Return the page."""
    found = dict(_commands())
    overview = table(
        ["command", ""], ([f"[`{name}`](#{_anchor(name)})", _first(c)] for name, c in found.items())
    )
    sections = [line for name, command in found.items() for line in ("", *_section(name, command))]
    return "\n".join([HEAD, *overview, *sections]) + "\n"


def _commands() -> Iterator[tuple[str, Command]]:
    """Yield every command with its full name; the commands of a group one by one."""
    for entry in own_entry_points(GROUP):
        name, registered = entry.name, entry.load()
        if not isinstance(registered, typer.Typer):
            yield name, registered
            continue
        for info in registered.registered_commands:
            assert info.callback is not None
            yield f"{name} {info.name or info.callback.__name__.replace('_', '-')}", info.callback


def _anchor(name: str) -> str:
    return f"armgate {name}".replace(" ", "-")


def _first(command: Command) -> str:
    return prose(inspect.getdoc(command) or "").split("\n\n")[0].replace("\n", " ")


def _section(name: str, command: Command) -> Iterator[str]:
    parameters = list(_parameters(command))
    rows = [_row(*parameter) for parameter in parameters]
    usage = " ".join(_usage(*parameter) for parameter in parameters if isinstance(parameter[2], ArgumentInfo))
    yield from (f"## armgate {name}", "", "```text", f"armgate {name} [OPTIONS] {usage}".rstrip(), "```", "")
    yield prose(inspect.getdoc(command) or "")
    if rows:
        yield from ("", *table(["argument or option", "value", "default", ""], rows))


def _parameters(command: Command) -> Iterator[tuple[str, Any, ArgumentInfo | OptionInfo, Any]]:
    """Yield name, type, typer's annotation and default of each parameter."""
    hints = get_type_hints(command, include_extras=True)
    for parameter in inspect.signature(command).parameters.values():
        hint, default = hints[parameter.name], parameter.default
        kind, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if isinstance(default, ArgumentInfo | OptionInfo):
            notes, default = [default], default.default
        info = next(note for note in notes if isinstance(note, ArgumentInfo | OptionInfo))
        if not info.hidden:
            yield parameter.name, kind, info, default


def _row(name: str, kind: Any, info: ArgumentInfo | OptionInfo, default: Any) -> tuple[str, str, str, str]:
    option = isinstance(info, OptionInfo)
    plain, repeatable = _plain(kind)
    flag = option and plain is bool
    shown = _names(name, info, both=flag and default is True) if option else [info.metavar or name.upper()]
    value = "" if flag else _value(plain, info) if option else _choices(plain)
    if repeatable and option:
        value += ", repeatable"
    if isinstance(info.show_default, str):
        usual = info.show_default
    else:
        usual = f"`{shown[0]}`" if flag and default is True else "" if flag else _default(default)
    names = ", ".join(f"`{each}`" for each in shown)
    return names, value, usual, re.sub(r"\s+", " ", info.help or "")


def _usage(name: str, kind: Any, info: ArgumentInfo | OptionInfo, default: Any) -> str:
    """Return an argument for the usage line: an optional one in brackets, a repeatable one with dots."""
    shown = info.metavar or name.upper()
    shown = shown if _default(default) == "required" else f"[{shown}]"
    return f"{shown}..." if _plain(kind)[1] else shown


def _plain(kind: Any) -> tuple[Any, bool]:
    """Return the type of one value, and True if the parameter can be repeated."""
    if get_origin(kind) in {Union, UnionType}:
        (kind,) = (each for each in get_args(kind) if each is not NoneType)
    origin = get_origin(kind)
    if origin in {list, tuple}:  # a tuple is several values of one option, such as X Y Z
        return get_args(kind)[0], origin is list
    return kind, False


def _names(name: str, info: ArgumentInfo | OptionInfo, both: bool) -> list[str]:
    """Return the spellings of an option; of a flag that is on by default, both."""
    # In Annotated, typer takes the first spelling for the default.
    first = [info.default] if isinstance(info.default, str) else []
    declared = [part for text in (*first, *(info.param_decls or ())) for part in text.split("/")]
    given = [part for part in declared if part.startswith("-")]
    if given:
        return given
    dashed = name.strip("_").replace("_", "-")
    return [f"--{dashed}", f"--no-{dashed}"] if both else [f"--{dashed}"]


def _value(plain: Any, info: ArgumentInfo | OptionInfo) -> str:
    if choices := _choices(plain):
        return choices
    shown = f"`{info.metavar or _PLACEHOLDERS[plain]}`"
    if info.min is not None and info.max is not None:
        return f"{shown}, {info.min:g} to {info.max:g}"
    if info.min is not None:
        return f"{shown}, at least {info.min:g}"
    return shown if info.max is None else f"{shown}, at most {info.max:g}"


def _choices(plain: Any) -> str:
    """Return the values of a closed set, or an empty text."""
    closed: list[Any] = [*plain] if isinstance(plain, type) and issubclass(plain, Enum) else []
    values = get_args(plain) if get_origin(plain) is Literal else [each.value for each in closed]
    return ", ".join(f"`{each}`" for each in values)


def _default(default: Any) -> str:
    if default is inspect.Parameter.empty or default is ...:
        return "required"
    if default is None or default in ((), [], ""):
        return ""
    if isinstance(default, Enum):
        default = default.value
    return f"`{default:g}`" if isinstance(default, float) else f"`{default}`"
