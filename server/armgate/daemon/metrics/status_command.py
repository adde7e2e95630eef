"""``armgate status``: the metrics that Prometheus reads, in readable form."""

from collections.abc import Mapping, Sequence
from http.client import HTTPException
from typing import Annotated, Any
from urllib.error import HTTPError
from urllib.parse import urlsplit
from urllib.request import urlopen

import typer

from armgate.cell.terminal_text import printable


class StatusError(Exception):
    """Address at which no metrics can be read."""

    exit_code = 1


class AddressError(Exception):
    """Address that is not HOST:PORT."""

    exit_code = 2


_DEFAULT = "127.0.0.1:7412"
_LARGEST = 16 << 20
"""Largest answer that is read, bytes."""


def status(
    address: Annotated[
        str,
        typer.Argument(
            metavar="HOST:PORT", help="Address at which the daemon serves its metrics (metrics.port)."
        ),
    ] = _DEFAULT,
    port: Annotated[
        int | None,
        typer.Option(min=1, max=65535, help="Port on 127.0.0.1, instead of HOST:PORT.", show_default=False),
    ] = None,
) -> None:
    """Print a daemon's metrics: verdicts, clearances, links, queues, lateness of ticks."""
    for family in _families(_place(address, port)):
        typer.echo(printable(family.documentation))
        if family.type == "histogram":
            typer.echo(f"  {_histogram(family.samples)}")
            continue
        for sample in family.samples:
            typer.echo(printable(f"  {_label(sample.labels)}: {sample.value:g}"))


def _label(labels: Mapping[str, str]) -> str:
    """Return the values of the labels, the robot first."""
    rest = [value for key, value in labels.items() if key != "robot" and value]
    return " ".join([labels["robot"], *rest] if "robot" in labels else rest)


def _place(address: str, port: int | None) -> str:
    """Return HOST:PORT.

    Raises:
        AddressError: The text is not an address, or both address and port are given.
    """
    if port is not None:
        if address != _DEFAULT:
            raise AddressError("both HOST:PORT and --port are given; expected one of them")
        return f"127.0.0.1:{port}"
    try:
        parts = urlsplit(f"//{address}")
        if parts.hostname and parts.port and parts.netloc == address and "@" not in address:
            return address
    except ValueError:
        pass
    raise AddressError(f"address {address!r}: expected HOST:PORT, such as {_DEFAULT}")


def _families(place: str) -> list[Any]:
    """Return the families of metrics that are served at HOST:PORT."""
    from prometheus_client.parser import text_string_to_metric_families

    try:
        with urlopen(f"http://{place}/metrics", timeout=5.0) as answer:
            return list(text_string_to_metric_families(answer.read(_LARGEST).decode()))
    except (HTTPException, HTTPError, ValueError) as error:
        text = f"{place} serves no metrics: {error or type(error).__name__}; give the address of metrics.port"
        raise StatusError(text) from error
    except OSError as error:
        why = getattr(error, "reason", error)
        text = f"no answer from {place}: {why}; configure metrics.port, or give its address"
        raise StatusError(text) from error


def _histogram(samples: Sequence[Any]) -> str:
    """Return count, mean, and the bounds below which 50 % and 99 % of the values lie."""
    buckets = [(float(s[1]["le"]), s[2]) for s in samples if s[0].endswith("_bucket")]
    count = next(s[2] for s in samples if s[0].endswith("_count"))
    total = next(s[2] for s in samples if s[0].endswith("_sum"))
    if not count:
        return "none yet"

    def below(share: float) -> float:
        return next(bound for bound, seen in buckets if seen >= share * count)

    ms = f"mean {1e3 * total / count:.3g} ms, 50 % below {1e3 * below(0.5):g} ms"
    return f"count {count:g}: {ms}, 99 % below {1e3 * below(0.99):g} ms"
