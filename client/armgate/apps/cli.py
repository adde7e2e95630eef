"""The root of the command line: ``armgate COMMAND …``.

A command is a function with typer annotations, or a ``typer.Typer`` with subcommands. Its package registers
it in the entry point group ``armgate.commands``. It is imported only when it is called, or listed by
``armgate --help``.

Exit status: 0 success, 1 failure, 2 wrong usage (options, configuration, files). An error of armgate or of
the operating system is printed on stderr, usually as one line. Any other exception is a defect; its traceback
is printed.
"""

import sys
from collections.abc import Callable, Iterable
from functools import partial
from importlib.metadata import EntryPoint, entry_points, version
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from armgate.cell.errors import install_hint

GROUP = "armgate.commands"
MAX_NUMBER = 1e6
"""Largest absolute value of a numeric option, in m, s, deg or counts."""

_EXTRAS = {
    "pinocchio": "cell",
    "coal": "cell",
    "fcl": "cell",
    "matplotlib": "plots",
    "viser": "view",
    "moderngl": "view",
    "pygame": "gamepad",
    "cryptography": "sign",
    "arro3": "campaign",
    "dask": "dask",
    "distributed": "dask",
}


def commands() -> dict[str, EntryPoint]:
    """Return the registered commands by name, not yet imported."""
    return {entry.name: entry for entry in sorted(entry_points(group=GROUP))}


class CommandGroup(TyperGroup):
    """Command group that imports a command when it is used."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands, in alphabetical order."""
        return list(commands())

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Import and return the command with this name; None if it is not registered."""
        entry = commands().get(cmd_name)
        return None if entry is None else as_command(cmd_name, entry.load())


def as_command(name: str, function: Callable[..., Any] | typer.Typer) -> Any:
    """Return a typer command for a group of functions, or for one function, whose docstring is the help."""
    app = function
    if not isinstance(app, typer.Typer):
        app = typer.Typer(add_completion=False)
        app.command(name)(function)
    command = typer.main.get_command(app)
    command.name = name
    _check_numbers(command)
    return command


def _check_numbers(command: Any) -> None:
    """Reject non-finite and huge numbers in all options of a command and its subcommands."""
    for parameter in command.params:
        parameter.callback = partial(_checked, parameter.callback)
    for inner in getattr(command, "commands", {}).values():
        _check_numbers(inner)


def _checked(callback: Callable[..., Any] | None, ctx: Any, parameter: Any, value: Any) -> Any:
    for number in value if isinstance(value, list | tuple) else (value,):
        # The range check of typer accepts nan, because every comparison with nan is false.
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
    """Define the options that precede the command."""


def main(arguments: Iterable[str] | None = None) -> NoReturn:
    """Run one command and exit with its status."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    try:
        typer.main.get_command(app)(args=given, prog_name="armgate")
    except KeyboardInterrupt:
        sys.exit(130)
    except Exception as error:
        text = explain(error)
        if text is None:
            raise
        print(f"armgate: {_printable(error, text)}", file=sys.stderr)
        sys.exit(exit_status(error))
    sys.exit(0)


def explain(error: Exception) -> str | None:
    """Return an error text for the user, usually one line; None if the error is a defect of armgate."""
    if isinstance(error, ModuleNotFoundError):
        extra = _EXTRAS.get((error.name or "").partition(".")[0])
        return extra and f"{error.name} is not installed; run {install_hint(extra)}"
    if type(error).__module__.startswith("armgate."):
        return str(error).strip() or type(error).__name__
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}" if error.filename else str(error)
    return None


def _printable(error: Exception, text: str) -> str:
    """Return a text without control characters; that of an error of the SDK as one line."""
    from armgate.cell.terminal_text import printable, printable_lines
    from armgate.client.errors import ClientError

    return printable(text) if isinstance(error, ClientError) else printable_lines(text)


def exit_status(error: Exception) -> int:
    """Return 2 if the input was wrong (a configuration, a file), else 1."""
    from armgate.cell.errors import ConfigError
    from armgate.client.errors import BadArgument

    return int(getattr(error, "exit_code", 2 if isinstance(error, ConfigError | BadArgument) else 1))
