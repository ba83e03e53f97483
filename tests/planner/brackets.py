"""A module of two pieces for tests: a wedge, and an angle bracket of two boxes."""

from itertools import product
from typing import Any, Final

from foldback.planner.chain.module_file import read_module


def box(low: list[float], high: list[float]) -> dict[str, Any]:
    """Return a part: a box between two corners."""
    return {"corners": [list(corner) for corner in product(*zip(low, high, strict=True))]}


HINGE: Final = {"kind": "hinge", "hinges": [{"axis": [0, 0, 1], "range_deg": [-90, 90]}]}
BRACKETS: Final = read_module(
    {
        "format": "foldback-module/1",
        "name": "bracket",
        "words": {"singular": "bracket", "plural": "brackets"},
        "pieces": [
            {
                "name": "wedge",
                "parts": [
                    {
                        "corners": [
                            [x, y, z]
                            for z in (-0.2, 0.2)
                            for x, y in ((-0.4, -0.2), (0.4, -0.2), (-0.4, 0.3))
                        ]
                    }
                ],
                "entry": {"at": [-0.45, 0, 0]},
                "exit": {"at": [0.45, 0, 0]},
                "joint": HINGE,
            },
            {
                "name": "angle",
                "parts": [
                    box([-0.35, -0.3, -0.2], [0.35, -0.1, 0.2]),
                    box([-0.35, -0.1, -0.2], [-0.15, 0.4, 0.2]),
                ],
                "entry": {"at": [-0.45, 0, 0]},
                "exit": {"at": [0.4, 0, 0]},
                "joint": HINGE,
            },
        ],
        "pattern": ["wedge", "angle"],
        "drawing": {"colours": ["#336699", "#ddccaa", "#112233"]},
    }
)
