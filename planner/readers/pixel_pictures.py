"""Pictures of pixels: PNG and JPEG, as brightness and opacity."""

from __future__ import annotations

import warnings
from io import BytesIO
from typing import TYPE_CHECKING, Final

import numpy as np

from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source
from foldback.planner.silhouettes.picture import Picture

if TYPE_CHECKING:
    from PIL import Image

PNG_MAGIC: Final = b"\x89PNG\r\n\x1a\n"
JPEG_MAGIC: Final = b"\xff\xd8\xff"
MAX_PIXELS: Final = 40_000_000
"""Maximum number of pixels of a picture; one whose header states more is refused before it is
decoded. Photos of most phones have 12 to 24 million."""
MAX_USED_SIDE: Final = 1024
"""Length, in pixels, to which the longer side of larger pictures is reduced: several pixels for
each cell of the finest drawing."""
NO_LIBRARY: Final = (
    "reading pictures needs packages that are not installed; install them with pip install "
    "'foldback[pictures]'."
)
DAMAGED: Final = (
    "the picture cannot be decoded: it is damaged or cut off; save it again with another program."
)


def is_pixel_picture(data: bytes) -> bool:
    """Return True if the bytes begin like a PNG or JPEG file."""
    return data.startswith((PNG_MAGIC, JPEG_MAGIC))


def read_pixel_picture(data: bytes, source: Source) -> Picture:
    """Return the pixels of a PNG or JPEG file, turned as its camera was held.

    Raises:
        InputError: ``too-large`` for too many pixels, ``damaged``, or ``no-library``.
    """
    try:
        from PIL import Image, ImageOps
    except ImportError as error:
        raise InputError("no-library", NO_LIBRARY) from error
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of parts of the file that are not used
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            image = Image.open(BytesIO(data), formats=("PNG", "JPEG"))
            width, height = image.size
            if width * height > MAX_PIXELS:
                raise _too_large(f"{width} × {height} pixels")
            image.draft("L", (MAX_USED_SIDE, MAX_USED_SIDE))  # decodes JPEGs smaller
            image.load()
            image = ImageOps.exif_transpose(image)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise _too_large("far more pixels") from error
    except (OSError, SyntaxError, ValueError, EOFError) as error:
        raise InputError("damaged", DAMAGED) from error
    return picture_of(image, source.name or "picture")


def picture_of(image: Image.Image, name: str, *, notes: tuple[str, ...] = ()) -> Picture:
    """Return the brightness and opacity of a decoded picture, reduced to the size that is used."""
    image.thumbnail((MAX_USED_SIDE, MAX_USED_SIDE))
    if image.mode.startswith(("I", "F")):  # 16 bits for each pixel
        values = np.asarray(image, dtype=np.float64)
        brightness = np.clip(values / 257.0, 0.0, 255.0).astype(np.uint8)
        return Picture(name=name, brightness=brightness, notes=notes)
    layers = np.asarray(image.convert("RGBA"))
    opacity = layers[..., 3]
    grey = layers[..., :3].astype(np.float64) @ (0.299, 0.587, 0.114)
    share = opacity / 255.0
    brightness = np.rint(grey * share + 255.0 * (1.0 - share)).astype(np.uint8)
    return Picture(name=name, brightness=brightness, opacity=opacity, notes=notes)


def _too_large(size: str) -> InputError:
    return InputError(
        "too-large",
        f"got a picture of {size}, expected at most {MAX_PIXELS // 1_000_000} million pixels; make "
        "it smaller.",
    )
