"""Deterministic simulation of the stack: daemon, robot server, clients, network and disk in one process.

    python -m tools.simulate [--seeds N] [--first S] [--seed S] [--steps N] [--jobs N] [--bug NAME] [--trace]
    python -m tools.simulate --bugs

Everything in a simulation follows from its seed. A seed that violates an invariant is printed with its
schedule of faults and the command that repeats it. docs/simulation.md explains what is simulated and checked.
"""

import sys

from tools.simulate import bugs
from tools.simulate.machine import interposed

interposed.install()
if "--bug" in sys.argv:
    bugs.install(sys.argv[sys.argv.index("--bug") + 1])

from tools.simulate.command import main  # noqa: E402 (after the clocks are replaced)

sys.exit(main())
