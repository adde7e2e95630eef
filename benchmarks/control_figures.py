"""Measure the figures of docs/control.md, and draw its pictures.

The follower of the demo cell in closed loop with an ideal robot of bounded acceleration: no gate, no daemon.

    PYTHONPATH=tests python benchmarks/control_figures.py docs/control
"""

import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib import pyplot as plt

from armgate.cell.cell import build_cell
from armgate.cell.config import load_config
from armgate.control.compiled import camera_law
from armgate.control.gains import Gains
from armgate.control.repulsion import Obstacles
from armgate.control.weights import LimitRule, LimitWeights
from support.follow_rig import Leader, Loop, Trace, approach_starts, dash, still

ROOT = Path(__file__).resolve().parents[1]
CELL = build_cell(load_config([ROOT / "configs" / "demo.yaml"]))
FR, LEADER = CELL.robot("FR"), Leader(CELL.robot("GR"))
LAW = camera_law(FR.model, "camera")
LOOP = Loop(FR, LEADER, LAW)
FOCUS = np.array([2.0, 0.0, 1.0])
SEEDS = range(20)
SETTLED = 3.0  # s


def time_of(trace: Trace) -> np.ndarray:
    return FR.period * np.arange(len(trace.angle))


def errors(traces: Iterable[Trace]) -> tuple[float, float, float]:
    """Return the largest angle, °, distance error, mm, and RMS angle of a run, °, after settling."""
    k, rows = round(SETTLED / FR.period), []
    for trace in traces:
        angle = np.degrees(trace.angle[k:])
        rows.append((angle.max(), 1e3 * np.abs(trace.distance[k:]).max(), np.sqrt((angle**2).mean())))
    worst = np.array(rows).max(axis=0)
    return float(worst[0]), float(worst[1]), float(worst[2])


def tracking() -> Iterator[str]:
    for speed, lag in ((0.25, 0.0), (0.25, 0.03), (0.25, 0.12), (0.5, 0.0), (1.0, 0.0)):
        cells = [f"{speed} m/s, {1e3 * lag:.0f} ms"]
        for predict in (False, True):
            runs = (LOOP.run(LEADER.path(s, speed), 10.0, lag=lag, predict=predict) for s in SEEDS)
            angle, distance, rms = errors(runs)
            cells.append(f"{angle:.3f}° / {distance:.2f} mm / {rms:.3f}°")
        yield " | ".join(cells)


def forms() -> Iterator[str]:
    options: dict[str, dict[str, Any]] = {
        "virtual time": {},
        "virtual time, predicted": {"predict": True},
        "real time": {"real_time": True},
        "real time, P ṗ": {"real_time": True, "predict": True},
    }
    for name, more in options.items():
        runs = (LOOP.run(LEADER.path(s, 0.25), 10.0, **{"predict": False, **more}) for s in range(6))
        yield "{} | {:.3f}° | {:.1f} mm | {:.3f}°".format(name, *errors(runs))


def measured_start() -> Iterator[str]:
    starts = approach_starts(FR, 8, FOCUS)
    for lag in (0.0, 0.03, 0.12):
        rises = []
        for measured in (False, True):
            runs = [LOOP.run(still(FOCUS), 4.0, start=q, lag=lag, measured=measured) for q in starts]
            rises.append(max(map(rise, runs)))
        yield f"{1e3 * lag:.0f} ms | {rises[0]:.2f}° | {rises[1]:.2f}°"


def rise(trace: Trace) -> float:
    angle = np.degrees(trace.angle)
    return float((angle - np.minimum.accumulate(angle)).max())


def settled(trace: Trace) -> float:
    off = np.nonzero((np.degrees(trace.angle) > 0.1) | (np.abs(trace.distance) > 2e-3))[0]
    return float(FR.period * (off.max(initial=-1) + 1))


def approach(folder: Path) -> Iterator[str]:
    figure, axes = plt.subplots(2, 1, figsize=(7, 5), sharex=True)
    traces = [LOOP.run(still(FOCUS), 3.5, start=q) for q in approach_starts(FR, 160, FOCUS)]
    for trace in traces[:20]:
        axes[0].plot(time_of(trace), np.degrees(trace.angle), lw=0.8)
        axes[1].plot(time_of(trace), trace.distance + 1.0, lw=0.8)
    axes[0].set(ylabel="angle error [°]", title="20 approaches from 30° to 150° off")
    axes[1].set(ylabel="view distance [m]", xlabel="time [s]", xlim=(0.0, 2.5))
    save(figure, folder, "approach")
    for count in (20, 160):
        some = traces[:count]
        times = [settled(trace) for trace in some]
        yield (
            f"{count} starts: {sum(rise(t) > 0.05 for t in some)} rise by more than 0.05° "
            f"(most {max(map(rise, some)):.3f}°), "
            f"settled after {np.median(times):.2f} s (median), {max(times):.2f} s (most)"
        )


def dodging(folder: Path) -> Iterator[str]:
    spheres, k = LAW.spheres.centres(FR.start), round(1.5 / FR.period)
    worst: list[float] = []
    shown: Trace | None = None
    for link in (5, 9, 13, 18):
        for seed in range(5):
            path = dash(spheres[link], seed, 0.5)
            trace = LOOP.run(still(FOCUS), 7.0, obstacles=_around(path))
            worst.append(float(np.degrees(trace.angle[k:]).max()))
            shown = trace if (link, seed) == (13, 1) else shown
    assert shown is not None
    figure, axes = plt.subplots(3, 1, figsize=(7, 6), sharex=True)
    axes[0].semilogy(time_of(shown)[k:], np.degrees(shown.angle[k:]).clip(1e-6))
    axes[0].set(ylabel="angle error [°]", title="The leader comes at the forearm at 0.5 m/s")
    axes[1].plot(time_of(shown)[k:], shown.distance[k:] + 1.0)
    axes[1].set(ylabel="view distance [m]")
    axes[2].plot(time_of(shown)[k:], [step.gap for step in shown.steps][k:])
    axes[2].axhline(LAW.gains.reach, ls=":", c="grey")
    axes[2].set(ylabel="least gap [m]", xlabel="time [s]")
    save(figure, folder, "dodging")
    yield f"{len(worst)} dashes: angle at most {max(worst):.4f}°"


def _around(path: Callable[[float], np.ndarray]) -> Callable[[float], Obstacles]:
    return lambda t: LEADER.obstacles(path(t))


def limits(folder: Path) -> Iterator[str]:
    x = np.linspace(-1.0, 1.0, 801)
    figure, axis = plt.subplots(figsize=(7, 3.2))
    for rule in LimitRule:
        weights = LimitWeights.of(FR.model, rule, Gains().limit)
        axis.plot(x, [weights.inverse(np.full(6, at))[0] for at in x], label=rule.value)
    axis.set(xlabel="position of A1 in its half range", ylabel="W⁻¹", title="Joint limit weights")
    axis.legend()
    save(figure, folder, "weights")
    for rule in LimitRule:
        law = camera_law(FR.model, "camera", Gains(limits=rule))
        loop, reached = Loop(FR, LEADER, law), []
        for joint in range(6):
            for sign in (-1.0, 1.0):
                for share in (0.97, 0.999):
                    q = np.array(FR.start)
                    q[joint] = (
                        0.5 * (FR.upper + FR.lower)[joint] + sign * share * 0.5 * (FR.upper - FR.lower)[joint]
                    )
                    trace = loop.run(still(FOCUS), 10.0, start=q, obstacles=lambda _: Obstacles())
                    reached.append(settled(trace))
        runs = (loop.run(LEADER.path(s, 0.25), 8.0, predict=False) for s in range(4))
        _, distance, _ = errors(runs)
        there = [t for t in reached if t < 9.9]
        slowest = f"{max(there):.1f} s" if there else "–"
        yield f"{rule.value} | {len(there)} of {len(reached)} | {slowest} | {distance:.1f} mm"


def save(figure: Any, folder: Path, name: str) -> None:
    figure.tight_layout()
    figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    plt.close(figure)


def main() -> None:
    mpl.use("svg")
    mpl.rcParams["svg.hashsalt"] = "armgate"
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    parts: dict[str, Callable[[], Iterator[str]]] = {
        "approach": lambda: approach(folder),
        "dodging": lambda: dodging(folder),
        "limits": lambda: limits(folder),
        "measured start": measured_start,
        "tracking": tracking,
        "forms": forms,
    }
    for name, part in parts.items():
        print(f"\n{name}")
        for line in part():
            print(line, flush=True)


if __name__ == "__main__":
    main()
