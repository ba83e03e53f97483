"""Draw the example shapes as SVG files: `python 05_draw_a_shape.py [FOLDER]`."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path as FilePath

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.path import Path
from foldback.planner.readers import read
from foldback.web.pictures.isometric_modules import chain_svg

SHAPES = FilePath(__file__).parent / "shapes"


def main() -> None:
    folder = FilePath(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())
    for file in sorted(SHAPES.glob("*.json")):
        shape = read(file.read_bytes())
        assert isinstance(shape, Path | Chain)
        chain = shape if isinstance(shape, Chain) else Chain.from_path(shape)
        drawing = chain_svg(chain, title=chain.name)
        (folder / f"{file.stem}.svg").write_text(drawing, encoding="utf-8")
        print(f"{folder / file.stem}.svg: {len(chain)} modules, {len(drawing) / 1000:.0f} kB")


if __name__ == "__main__":
    main()
