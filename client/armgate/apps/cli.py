"""The root of the command line: ``armgate COMMAND …``.

A command is a function with typer annotations, or a group of such, that its owner registers in the group
``armgate.commands`` of entry points. It is imported only when it is called, or named in ``armgate --help``.

Exit status: 0 done, 1 failed, 2 called wrongly (options, configuration, files). An error of ours, or of the
operating system, is one line on stderr; anything else is a defect and shows its traceback.
"""

import sys
from collections.abc import Callable, Iterable
from functools import partial
from importlib.metadata import EntryPoint, entry_points, version
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from armgate.cell.extras import install

GROUP = "armgate.commands"
MAX_NUMBER = 1e6
"""Largest number that an option may have, in m, s, deg or what it counts in."""

_EXTRAS = {
    "pinocchio": "cell",
    "coal": "cell",
    "fcl": "cell",
    "matplotlib": "plots",
    "viser": "view",
    "moderngl": "view",
    "pygame": "gamepad",
    "cryptography": "sign",
}


def commands() -> dict[str, EntryPoint]:
    """The registered commands by name, not yet imported."""
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP))}


class CommandGroup(TyperGroup):
    """A group that imports a command when it is asked for it."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Names of all commands, in alphabetical order."""
        return list(commands())

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The command of this name, imported now; None if there is none."""
        entry = commands().get(cmd_name)
        return None if entry is None else as_command(cmd_name, entry.load())


def as_command(name: str, function: Callable[..., Any] | typer.Typer) -> Any:
    """A typer command of a plain annotated function, whose docstring is its help; or a group of such."""
    app = function
    if not isinstance(app, typer.Typer):
        app = typer.Typer(add_completion=False)
        app.command(name)(function)
    command = typer.main.get_command(app)
    command.name = name
    _refuse_strange_numbers(command)
    return command


def _refuse_strange_numbers(command: Any) -> None:
    """Check the numbers of all options of a command and of its commands, whatever it does with them."""
    for parameter in command.params:
        parameter.callback = partial(_with_usual_numbers, parameter.callback)
    for inner in getattr(command, "commands", {}).values():
        _refuse_strange_numbers(inner)


def _with_usual_numbers(callback: Callable[..., Any] | None, ctx: Any, parameter: Any, value: Any) -> Any:
    for number in value if isinstance(value, list | tuple) else (value,):
        # A range alone does not refuse nan: it compares with nothing.
        if isinstance(number, float) and not abs(number) <= MAX_NUMBER:
            text = f"{number:g} is out of range; expected a finite number within ±{MAX_NUMBER:,.0f}"
            raise typer.BadParameter(text, ctx=ctx, param=parameter)
    return value if callback is None else callback(ctx, parameter, value)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"armgate {version('armgate')}")
        raise typer.Exit


app = typer.Typer(
    cls=CommandGroup,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback(help="A safety gate between experimental controllers and robot arms.")
def root(
    _version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit."),
    ] = False,
) -> None:
    """Holds the options that stand before the command."""


def main(arguments: Iterable[str] | None = None) -> NoReturn:
    """Runs one command and exits with its status."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        typer.main.get_command(app)(args=given, prog_name="armgate")
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        text = explain(error)
        if text is None:
            raise
        print(f"armgate: {_shown(error, text)}", file=sys.stderr)
        sys.exit(exit_status(error))
    sys.exit(0)


def explain(error: Exception) -> str | None:
    """What to tell a user who can do something about it, usually one line; None for a defect of ours."""
    if isinstance(error, ModuleNotFoundError):
        extra = _EXTRAS.get((error.name or "").partition(".")[0])
        return extra and f"{error.name} is not installed; run {install(extra)}"
    if type(error).__module__.startswith("armgate."):
        return str(error).strip() or type(error).__name__
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}" if error.filename else str(error)
    return None


def _shown(error: Exception, text: str) -> str:
    """A text of a peer in one line; findings in a configuration stand on a line each."""
    from armgate.cell.text import printable, printable_lines
    from armgate.client.errors import ClientError

    return printable(text) if isinstance(error, ClientError) else printable_lines(text)


def exit_status(error: Exception) -> int:
    """2 where what was given is wrong (a bad configuration, a bad file), else 1."""
    from armgate.cell.errors import ConfigError
    from armgate.client.errors import BadArgument

    return int(getattr(error, "exit_code", 2 if isinstance(error, ConfigError | BadArgument) else 1))
