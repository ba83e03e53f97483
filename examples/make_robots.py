"""Make the gallery's published robots: `python examples/make_robots.py`.

Each robot folds into three shapes. `bench/sweeps/gallery.toml` folds them, and so does
`make bench ARGS="--only robots"`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import DEFAULT_PITCH_M
from foldback.planner.plan.shape_writers import write_chain

HERE = Path(__file__).parent
TITLES: Final = {
    "sea-snake": "SEA Snake",
    "yamor": "YaMoR",
    "polybot-g2": "PolyBot G2",
    "molecube": "Molecubes",
    "rofi": "RoFI",
}
"""Names of the robots for people."""
ALTERNATING: Final = (1.0, 0.0, -1.0, 0.0)
"""Signs with which the hinges of one plane bend the same way, where each hinge is at a right angle
to the one before it."""


def bent(angle_deg: float, joints: int) -> list[float]:
    """Return angles that bend a chain of alternating hinges in one plane."""
    return [angle_deg * ALTERNATING[k % 4] for k in range(joints)]


SHAPES: Final[dict[str, dict[str, list[float]]]] = {
    "sea-snake": {
        "ring": bent(34.0, 19),
        "coil": [25.0] * 15,
        "ball": [-90, 90, -90, -90, 90, 90, 90, -90, -90, 90, -90],
    },
    "yamor": {
        "ring": [28.0] * 11,
        "spiral": [90, 0, 0, 0, 90, 0, 0, 0, 90, 0, 0, 90, 0, 0, 90, 0, 90],
        "meander": [90, 90, 0, -90, -90, 0, 90, 90, 0, -90, -90],
    },
    "polybot-g2": {
        "ring": bent(34.0, 19),
        "coil": [30.0] * 15,
        "ball": [-90, 90, 90, -90, -90, 0, 90, -90, -90, -90, 90],
    },
    "molecube": {
        "block-9": [0, 120, -120, -120, 0, -120, -120, 0],
        "block-13": [-120, 120, 120, -120, -120, 0, 120, 0, -120, 0, -120, 120],
        "coil": [(0.0 if k % 3 == 0 else -120.0) for k in range(13)],
    },
    "rofi": {
        "ring": [(0.0 if k % 3 == 1 else 21.0) for k in range(23)],
        "coil": [(20.0 if k % 3 == 1 else 40.0) for k in range(23)],
        "ball": [
            *(0, 90, 90, 0, 0, 90, 90, 90, 90, -90, -90, -90),
            *(-90, 0, 0, -90, 90, 0, 90, 90, 90, 90, 0),
        ],
    },
}
"""Joint angles of each shape of each robot, in degrees."""


def chains() -> list[tuple[Chain, str, tuple[str, ...]]]:
    """Return the chains with their titles and tags."""
    labelled: list[tuple[Chain, str, tuple[str, ...]]] = []
    for robot, shapes in SHAPES.items():
        module = module_named(robot)
        for shape, angles in shapes.items():
            chain = Chain.from_angles(
                module,
                np.deg2rad(angles),
                name=f"{robot}-{shape}",
                pitch_m=module.pitch_m or DEFAULT_PITCH_M,
            )
            title = f"{TITLES[robot]}, {shape.replace('-', ' ')}"
            labelled.append((chain, title, ("robot",)))
    return labelled


def main() -> None:
    """Write one chain file for each shape."""
    for chain, title, tags in chains():
        data = write_chain(chain, title=title, tags=tags)
        (HERE / "shapes" / f"{chain.name}.json").write_bytes(data)


if __name__ == "__main__":
    main()
