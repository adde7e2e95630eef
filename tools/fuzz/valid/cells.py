"""Random cells, from one robot of one joint to the largest that the protocol allows."""

from pathlib import Path
from random import Random

from armgate.cell.config import CellConfig, load_config

_BODIES = 3
"""Number of links with a body in each robot."""

PARTICIPANTS = ("lead", "follow", "wave")


def make(folder: Path, rng: Random, robots: int, joints: int, *, lockstep: bool = False) -> CellConfig:
    """Return a cell of ``robots`` robots, each of up to ``joints`` joints, written to ``folder``."""
    long = rng.random() < 0.2
    names = [f"R{i}".ljust(40 if long else 1, "_") for i in range(robots)]
    lines = ["armgate: 1", "name: fuzz", f"stop_distance: {rng.choice((5, 50))} mm", "self_distance: 1 mm"]
    lines += [f"response: {rng.choice(('stop', 'slow'))}", f"max_age_ticks: {rng.choice((1, 3, 1000))}"]
    lines.append("robots:")
    counts = sorted({1, joints, rng.randint(1, joints)})
    for count in counts:
        (folder / f"arm{count}.urdf").write_text(_urdf(rng, count, long))
    for index, name in enumerate(names):
        count = joints if index == 0 else rng.choice(counts)
        base = f"{{xyz: [{0.3 * (index % 6)}, {0.3 * (index // 6)}, 0]}}"
        lines += [f"  {name}:", f"    urdf: arm{count}.urdf", f"    base: {base}", "    tool: tool0"]
        lines += [f"    start: [{', '.join('0' for _ in range(count))}]"]
        lines += [f"    period: {rng.choice((0.004, 0.012, 0.012))}"]
        lines += [f"    link: {{kind: emulated, lag: {rng.choice((0.0, 0.03))}}}"]
    lines += ["surroundings:", "  wall: {shape: {box: [0.1, 4, 4]}, xyz: [-1.5, 0, 0]}"]
    lines += ["server:", "  port: 0", f"  signal_rate: {rng.choice((5, 1000))}"]
    if lockstep:
        lines += [f"clock: {{kind: lockstep, participants: [{', '.join(PARTICIPANTS)}], grace: 60}}"]
    file = folder / "cell.yaml"
    file.write_text("\n".join(lines) + "\n")
    return load_config([file])


def _urdf(rng: Random, joints: int, long: bool) -> str:
    """Return a chain of joints of both kinds that stays short, with spheres on some links."""
    bodies = {joints, *(rng.randint(1, joints) for _ in range(_BODIES - 1))}
    parts = ['<robot name="arm">', '<link name="base"/>']
    for i in range(1, joints + 1):
        body = f'<collision><geometry><sphere radius="{0.02}"/></geometry></collision>' if i in bodies else ""
        parts.append(f'<link name="{_link(i, joints)}">{body}</link>')
        kind = rng.choice(("revolute", "prismatic"))
        reach = 0.5 if kind == "revolute" else 0.4 / joints
        name = f"j{i}".ljust(64 if long else 1, "-")
        axis = rng.choice(("1 0 0", "0 1 0", "0 0 1"))
        parts.append(
            f'<joint name="{name}" type="{kind}"><parent link="{_link(i - 1, joints)}"/>'
            f'<child link="{_link(i, joints)}"/><origin xyz="0 0 {0.6 / joints}"/><axis xyz="{axis}"/>'
            f'<limit lower="{-reach}" upper="{reach}" velocity="1" effort="1"/></joint>'
        )
    return "\n".join([*parts, "</robot>"])


def _link(index: int, joints: int) -> str:
    return "base" if index == 0 else "tool0" if index == joints else f"l{index}"
