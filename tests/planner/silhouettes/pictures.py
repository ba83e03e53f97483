"""Pictures for tests."""

from __future__ import annotations

from io import BytesIO
from struct import pack
from zlib import crc32

import numpy as np
from numpy.typing import NDArray
from PIL import Image


def as_picture(pixels: NDArray[np.uint8], kind: str = "PNG", **options: object) -> bytes:
    """Return the bytes of a PNG or JPEG file with the given pixels."""
    stream = BytesIO()
    Image.fromarray(pixels).save(stream, kind, **options)
    return stream.getvalue()


def ring(size: int = 120) -> NDArray[np.uint8]:
    """Return a black square with a square hole, on white."""
    pixels = np.full((size, size), 255, dtype=np.uint8)
    pixels[size // 6 : -size // 6, size // 6 : -size // 6] = 0
    pixels[size // 3 : -size // 3, size // 3 : -size // 3] = 255
    return pixels


def png_header(width: int, height: int, pixels: bytes = b"") -> bytes:
    """Return a PNG file that declares a size, and holds compressed pixels or none."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return pack(">I", len(data)) + kind + data + pack(">I", crc32(kind + data))

    header = chunk(b"IHDR", pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
