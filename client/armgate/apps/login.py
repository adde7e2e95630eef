"""How a program says who it is: a token from a file or the environment, certificates from files.

Never from the command line itself, which everybody on the machine can read.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from armgate.apps.errors import UsageError

if TYPE_CHECKING:
    from ssl import SSLContext

VARIABLE = "ARMGATE_TOKEN"

TokenFile = Annotated[
    Path | None,
    typer.Option(
        help=f"File that holds the token; by default it is taken from {VARIABLE}.", show_default=False
    ),
]
Ca = Annotated[
    Path | None,
    typer.Option(help="Connect with TLS, trusting this CA (PEM).", show_default=False),
]
Cert = Annotated[
    Path | None,
    typer.Option(help="Own certificate (PEM), where the daemon asks for one.", show_default=False),
]
Key = Annotated[Path | None, typer.Option(help="Its private key (PEM).", show_default=False)]


class Login(TypedDict):
    """What ``connect`` is given."""

    token: str | None
    tls: "SSLContext | None"


def login(token_file: Path | None, ca: Path | None, cert: Path | None, key: Path | None) -> Login:
    """Who this program is.

    Raises:
        UsageError: The token's file holds no token, or certificates are given without a CA.
        BadArgument: A certificate cannot be used.
    """
    from armgate.client import tls_context  # noqa: PLC0415

    if ca is None and (cert or key):
        raise UsageError("--cert and --key need TLS: give the daemon's CA too (--ca FILE)")
    tls = None if ca is None else tls_context(ca, cert, key)
    return Login(token=_token(token_file), tls=tls)


def _token(file: Path | None) -> str | None:
    from armgate.client import BadArgument, read_token  # noqa: PLC0415

    if file is None:
        return os.environ.get(VARIABLE) or None
    try:
        return read_token(file)
    except BadArgument as error:
        raise UsageError(str(error)) from error
