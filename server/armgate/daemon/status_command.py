"""``armgate status``: the figures that Prometheus reads, for people."""

from collections.abc import Mapping, Sequence
from typing import Annotated, Any
from urllib.error import URLError
from urllib.request import urlopen

import typer

from armgate.cell.text import printable


class StatusError(Exception):
    """No figures are to be had there."""

    exit_code = 1


def status(
    port: Annotated[int, typer.Option(min=1, max=65535, help="Where the daemon serves its figures.")] = 7412,
) -> None:
    """Print a daemon's figures: verdicts, clearance, links, queues, how late ticks were heard of."""
    from prometheus_client.parser import text_string_to_metric_families  # noqa: PLC0415

    for family in text_string_to_metric_families(_fetched(port)):
        typer.echo(printable(family.documentation))
        if family.type == "histogram":
            typer.echo(f"  {_histogram(family.samples)}")
            continue
        for sample in family.samples:
            typer.echo(printable(f"  {_label(sample.labels)}: {sample.value:g}"))


def _label(labels: Mapping[str, str]) -> str:
    """The robot, then the rest."""
    rest = [value for key, value in labels.items() if key != "robot" and value]
    return " ".join([labels["robot"], *rest] if "robot" in labels else rest)


def _fetched(port: int) -> str:
    try:
        with urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5.0) as answer:
            return str(answer.read().decode())
    except (URLError, OSError) as error:
        why = getattr(error, "reason", error)
        text = f"nothing answers on 127.0.0.1:{port}: {why}; configure metrics.port, or name it with --port"
        raise StatusError(text) from error


def _histogram(samples: Sequence[Any]) -> str:
    """Count, mean, and the bounds below which half and 99 % of the values are."""
    buckets = [(float(s[1]["le"]), s[2]) for s in samples if s[0].endswith("_bucket")]
    count = next(s[2] for s in samples if s[0].endswith("_count"))
    total = next(s[2] for s in samples if s[0].endswith("_sum"))
    if not count:
        return "none yet"

    def below(share: float) -> float:
        return next(bound for bound, seen in buckets if seen >= share * count)

    ms = f"mean {1e3 * total / count:.3g} ms, half below {1e3 * below(0.5):g} ms"
    return f"{count:g} of them: {ms}, 99 % below {1e3 * below(0.99):g} ms"
