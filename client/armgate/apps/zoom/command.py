"""``armgate zoom``: an operator who zooms in and out; the follower keeps the distance that is shared."""

from typing import Annotated

import typer

from armgate.apps.connection import Ca, Cert, Key, TokenFile, login


def zoom(
    address: Annotated[str, typer.Argument(metavar="HOST:PORT", help="Where the daemon listens.")],
    *,
    low: Annotated[float, typer.Option(min=0.05, help="Smallest wanted distance, m.")] = 0.5,
    high: Annotated[float, typer.Option(min=0.05, help="Largest wanted distance, m.")] = 1.3,
    start: Annotated[float, typer.Option(min=0.05, help="Wanted distance at first, m.")] = 1.0,
    rate: Annotated[float, typer.Option(min=0.001, help="How fast it changes, m/s.")] = 0.1,
    seed: Annotated[int, typer.Option(help="What is wanted when; the same seed, the same wishes.")] = 0,
    duration: Annotated[
        float | None,
        typer.Option(min=0.1, metavar="S", help="End after S seconds; else at Ctrl-C.", show_default=False),
    ] = None,
    name: Annotated[str, typer.Option(help="This participant's name.")] = "operator",
    token_file: TokenFile = None,
    ca: Ca = None,
    cert: Cert = None,
    key: Key = None,
) -> None:
    """Change the wanted view distance as an operator would."""
    from armgate.apps.errors import UsageError
    from armgate.apps.interrupt import interrupt
    from armgate.apps.zoom.wishes import Wishes, share
    from armgate.client import connect

    if not low <= start <= high:
        raise UsageError(f"expected --low ≤ --start ≤ --high, got {low:g}, {start:g} and {high:g} m")
    own = login(token_file, ca, cert, key)
    with interrupt() as wish, connect(address, name=name, role="operator", **own) as cell:
        share(cell, Wishes(low, high, start, rate, seed), wish, duration)
