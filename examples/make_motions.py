"""Make the moving drawings of the gallery's cards: web/motions.zip.

python examples/make_motions.py

Drawings that the archive has of the present shapes stay; the other shapes are folded.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.readers.gallery import GalleryShape, gallery
from foldback.planner.storage.file_names import TIMELINE
from foldback.server.cli.play import row_of
from foldback.web.pictures.isometric_modules import chain_drawing
from foldback.web.pictures.shipped_pictures import MOTIONS_ARCHIVE, shipped_motion
from foldback.web.timeline.folding_drawing import folding_drawing
from foldback.web.timeline.view import TimelineView


def main() -> None:
    """Write the archive."""
    drawings: dict[str, str] = {}
    for shape in gallery():
        shipped = (shipped_motion(shape.name) or b"").decode()
        drawings[shape.name] = shipped if is_of_shape(shipped, shape) else folded(shape)
    with ZipFile(MOTIONS_ARCHIVE, "w", ZIP_DEFLATED, compresslevel=9) as archive:
        for name, drawing in drawings.items():
            archive.writestr(ZipInfo(f"{name}.svg"), drawing, ZIP_DEFLATED)
    print(f"{MOTIONS_ARCHIVE.name}: {MOTIONS_ARCHIVE.stat().st_size / 1e3:.0f} kB")


def is_of_shape(drawing: str, shape: GalleryShape) -> bool:
    """Return True if a moving drawing ends in the drawing of a shape."""
    return chain_drawing(shape.chain).body in drawing


def folded(shape: GalleryShape) -> str:
    """Fold a shape and return the moving drawing of the fold.

    Raises:
        SystemExit: If the plan is not verified.
    """
    with tempfile.TemporaryDirectory() as place:
        directory = Path(place)
        Workspace(directory).write_request(FoldRequest(filename=shape.filename), shape.data)
        run_stages(directory)
        if row_of(directory).status != "verified":
            raise SystemExit(f"got no verified plan of {shape.name}, expected one.")
        return folding_drawing(TimelineView(directory / TIMELINE))


if __name__ == "__main__":
    main()
