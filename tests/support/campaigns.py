"""Small campaigns for tests: the planar cell, trials of a few ticks, and programs that misbehave."""

from pathlib import Path

from armgate.campaign.drive import Campaign

PLANAR = Path(__file__).parents[2] / "configs" / "planar.yaml"

PROGRAMS = """
import os, signal, sys, time
from armgate.client.program import TickProgram

class Odd(TickProgram):
    def __init__(self, context, act):
        self.seed, self.act = context.seed, act
    def step(self, tick):
        return self.act(tick)

class Wordless(Exception):
    def __str__(self): raise RuntimeError("no words")

def interrupted(tick): raise KeyboardInterrupt
def wordless(tick): raise Wordless

def small(tick):
    return [0.001, 0.0, 0.0]

def move(context): return Odd(context, small)
def bad(context): return Odd(context, lambda tick: 1 / 0)
def killed(context): return Odd(context, lambda tick: os.kill(os.getpid(), signal.SIGKILL))
def quits(context): return Odd(context, lambda tick: os._exit(0))
def stuck(context): return Odd(context, lambda tick: time.sleep(60))
def ends(context): return Odd(context, lambda tick: None if tick.time > 0.03 else small(tick))
def clock(context): return Odd(context, lambda tick: [1e-6 * (time.time_ns() % 997), 0.0, 0.0])
def leaves(context): return Odd(context, lambda tick: sys.exit(4))
def interrupts(context): return Odd(context, interrupted)
def silent(context): return Odd(context, wordless)
def reads(context): return open("/no/such/file")
def ticks(series): return float(len(series.robots["P"].time))
def infinite(series): return float("inf")
"""

TEXT = """armgate: 1
name: small
cell: [{planar}]
duration: 60 ms
seeds: {seeds}
controllers:
{controllers}
vary:
  cell.robots.P.start.1: {{uniform: [40 deg, 50 deg]}}
{more}
"""


def write_campaign(
    folder: Path, *, seeds: int = 4, programs: tuple[str, ...] = ("move",), more: str = ""
) -> Path:
    """Write a campaign with a set of controllers for each program of ``odd.py``; return its file."""
    (folder / "odd.py").write_text(PROGRAMS, encoding="utf-8")
    controllers = "\n".join(f'  {name}: {{P: {{program: "odd:{name}"}}}}' for name in programs)
    file = folder / "small.yaml"
    text = TEXT.format(planar=PLANAR, seeds=seeds, controllers=controllers, more=more)
    file.write_text(text, encoding="utf-8")
    return file


def small_campaign(folder: Path, **options: object) -> Campaign:
    """Return the campaign of `write_campaign`."""
    return Campaign.load(write_campaign(folder, **options))  # type: ignore[arg-type]
