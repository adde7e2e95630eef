"""Small cells for tests: planar three-link arms far from each other."""

from pathlib import Path

from armgate.cell.config import CellConfig, load_config

URDF = Path(__file__).parents[2] / "configs" / "robots" / "planar3.urdf"


def arms_yaml(names="A,B", periods=(0.012, 0.012), lag=0.0, **more):
    """Return the text of a configuration with planar arms 10 m apart and a post.

    ``more`` are additional lines of the top level.
    """
    lines = ["armgate: 1", "name: arms", "stop_distance: 20 mm", "self_distance: 10 mm", "robots:"]
    for index, (name, period) in enumerate(zip(names.split(","), periods, strict=False)):
        lines += [
            f"  {name}:",
            f"    urdf: {URDF}",
            f"    base: {{xyz: [0, {10 * index}, 0.5]}}",
            "    start: [0 deg, 45 deg, 45 deg]",
            f"    period: {period}",
            f"    link: {{kind: emulated, lag: {lag}}}",
        ]
    lines += ["surroundings:", "  post: {shape: {cylinder: [0.05, 1.0]}, xyz: [0.6, 0.9, 0.5]}"]
    lines += [f"{key}: {value}" for key, value in more.items()]
    return "\n".join(lines) + "\n"


def arms_config(folder: Path, **options) -> CellConfig:
    """Return the same as a loaded configuration."""
    file = folder / "arms.yaml"
    file.write_text(arms_yaml(**options))
    return load_config([file])
