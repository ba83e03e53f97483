"""Make the pictures that ship with the package, so that no page waits for a drawing.

python examples/make_pictures.py
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from zipfile import ZIP_DEFLATED, ZipFile, ZipInfo

from foldback.planner.chain.chain import Chain
from foldback.planner.readers.gallery import GalleryShape, gallery
from foldback.web.pictures.isometric_modules import chain_svg
from foldback.web.pictures.shipped_pictures import ARCHIVE
from foldback.web.pictures.social_picture import social_picture
from foldback.web.viser.scene_bundle import bundle_of

FEATURED = "wrench-160"
CARD_SIZE, HERO_SIZE = 160, 480
"""Width and height of a drawing in CSS pixels."""


def pictures() -> Iterator[tuple[str, Callable[[], bytes]]]:
    """Yield the name of each picture and the function that makes it."""
    for shape in gallery():
        yield f"{shape.name}-{CARD_SIZE}.svg", partial(_svg, shape, CARD_SIZE)
        if shape.name == FEATURED:
            chain = shape.chain
            yield f"{shape.name}-{HERO_SIZE}.svg", partial(_svg, shape, HERO_SIZE)
            yield "featured.png", partial(_png, chain)
            yield "featured.bundle", partial(bundle_of, chain)


def _svg(shape: GalleryShape, size: int) -> bytes:
    return chain_svg(shape.chain, size=size).encode()


def _png(chain: Chain) -> bytes:
    return social_picture(chain)


def main() -> None:
    """Write the archive; equal pictures make equal bytes."""
    with ZipFile(ARCHIVE, "w", ZIP_DEFLATED, compresslevel=9) as archive:
        for name, make in pictures():
            archive.writestr(ZipInfo(name), make(), ZIP_DEFLATED)
    print(f"{ARCHIVE.name}: {ARCHIVE.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
