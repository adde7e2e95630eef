"""Options of the commands that connect to a daemon: its address, the token and the certificates.

Secrets come from files or the environment, never from the command line, which every user of the machine can
read.
"""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from armgate.apps.errors import UsageError

if TYPE_CHECKING:
    from ssl import SSLContext

VARIABLE = "ARMGATE_TOKEN"

Address = Annotated[str, typer.Argument(metavar="HOST:PORT", help="Address of the daemon.")]
TokenFile = Annotated[
    Path | None,
    typer.Option(
        help=f"File with the token (default: the environment variable {VARIABLE}).", show_default=False
    ),
]
Ca = Annotated[
    Path | None,
    typer.Option(help="Connect with TLS and trust this CA (PEM).", show_default=False),
]
Cert = Annotated[
    Path | None,
    typer.Option(help="Client certificate (PEM), if the daemon requires one.", show_default=False),
]
Key = Annotated[
    Path | None, typer.Option(help="Private key of the client certificate (PEM).", show_default=False)
]


class Login(TypedDict):
    """Token and TLS context, as keyword arguments of ``connect``."""

    token: str | None
    tls: "SSLContext | None"


def login(token_file: Path | None, ca: Path | None, cert: Path | None, key: Path | None) -> Login:
    """Read the token and the certificates that the options name.

    Raises:
        UsageError: The token file holds no token, or certificates are given without a CA.
        BadArgument: A certificate cannot be used.
    """
    from armgate.client import tls_context

    if ca is None and (cert or key):
        raise UsageError("--cert and --key need TLS: also give the daemon's CA (--ca FILE)")
    tls = None if ca is None else tls_context(ca, cert, key)
    return Login(token=_token(token_file), tls=tls)


def _token(file: Path | None) -> str | None:
    from armgate.client import BadArgument, read_token

    if file is None:
        return os.environ.get(VARIABLE) or None
    try:
        return read_token(file)
    except BadArgument as error:
        raise UsageError(str(error)) from error
