"""Draw the README's still pictures: the same wrench in cubes and in tetrahedra.

Run from the repository's root::

    .venv/bin/python docs/make_drawings.py
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from foldback.planner.chain.chain import Chain  # noqa: E402
from foldback.planner.chain.path import Path as CellPath  # noqa: E402
from foldback.planner.readers import read  # noqa: E402
from foldback.web.pictures.isometric_modules import chain_svg  # noqa: E402

PICTURES = (
    ("wrench-cubes.svg", "wrench-128", "A wrench of 128 cubes"),
    ("wrench-tetrahedra.svg", "tetra-wrench", "The same wrench of 192 tetrahedra"),
)


def draw_shape(shape: str, title: str) -> str:
    """Return the drawing of an example shape as SVG."""
    shape_path = read((ROOT / "examples" / "shapes" / f"{shape}.json").read_bytes())
    assert isinstance(shape_path, CellPath | Chain)
    chain = shape_path if isinstance(shape_path, Chain) else Chain.from_path(shape_path)
    return chain_svg(chain, size=380, title=title) + "\n"


def main() -> None:
    """Write the pictures."""
    for name, shape, title in PICTURES:
        (ROOT / "docs" / "pictures" / name).write_text(draw_shape(shape, title), encoding="utf-8")


if __name__ == "__main__":
    main()
