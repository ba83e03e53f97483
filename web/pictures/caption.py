"""Caption: the name and the verdict of a fold, written into its social picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from PIL import Image, ImageDraw, ImageFont

VERIFIED_RGB: Final = (30, 122, 60)
FAILED_RGB: Final = (190, 24, 30)
DETAIL_RGB: Final = (92, 96, 104)
TEXT_RGB: Final = (28, 31, 36)
BAND_RGB: Final = (252, 251, 249)
BAND_HEIGHT_PX: Final = 108
"""Height of the caption band at the bottom of a fold's preview picture for social networks, in
pixels. A larger value hides more of the chain. Chosen."""
FAILED_BAND_PX: Final = 84
"""Height of the red band at the top of the preview picture of a failed fold, in pixels. A larger
value hides more of the chain. Chosen."""
SIDE_MARGIN_PX: Final = 40
"""Distance of a caption's text from the left and from the right edge of a preview picture, in
pixels. A larger value leaves less room for the fold's name. Chosen."""
NAME_PX: Final = 44
"""Largest font size of the fold's name in a picture's caption, in pixels; a long name is drawn
smaller. Chosen."""
VERDICT_PX: Final = 30


@dataclass(frozen=True, slots=True)
class Caption:
    """Caption of a picture.

    Attributes:
        name: Name of the fold.
        verdict: A few words.
        tone: "good", "bad" or something else.
    """

    name: str
    verdict: str
    tone: str


def write_caption(picture: Image.Image, caption: Caption) -> None:
    """Write a caption into an RGB picture; a failure gets a red band with a cross besides."""
    pen = ImageDraw.Draw(picture)
    width, height = picture.size
    top = height - BAND_HEIGHT_PX
    pen.rectangle((0, top, width, height), fill=BAND_RGB)
    colour = {"good": VERIFIED_RGB, "bad": FAILED_RGB}.get(caption.tone, DETAIL_RGB)
    verdict = ImageFont.load_default(VERDICT_PX)
    right = width - SIDE_MARGIN_PX - pen.textlength(caption.verdict, verdict)
    middle = top + BAND_HEIGHT_PX / 2
    pen.text((right, middle), caption.verdict, colour, verdict, anchor="lm")
    _mark(pen, right - 44, middle, 14.0, caption.tone, colour)
    name = ImageFont.load_default(NAME_PX)
    pen.text(
        (SIDE_MARGIN_PX, middle),
        _fitting(pen, caption.name, name, right - 80 - SIDE_MARGIN_PX),
        TEXT_RGB,
        name,
        "lm",
    )
    if caption.tone != "bad":
        return
    pen.rectangle((0, 0, width, FAILED_BAND_PX), fill=FAILED_RGB)
    pen.rectangle((0, 0, width - 1, height - 1), outline=FAILED_RGB, width=10)
    _mark(pen, SIDE_MARGIN_PX + 16, FAILED_BAND_PX / 2, 20.0, "bad", BAND_RGB)
    pen.text(
        (SIDE_MARGIN_PX + 60, FAILED_BAND_PX / 2), "This fold failed", BAND_RGB, name, anchor="lm"
    )


def _fitting(
    pen: ImageDraw.ImageDraw,
    text: str,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    width: float,
) -> str:
    """Return as much of a text as has room. Letters that the font lacks are left out."""
    shown = "".join(c if ord(c) < 0x250 or c in "×–—’“”→" else "" for c in text).strip()
    if pen.textlength(shown, font) <= width:
        return shown
    while shown and pen.textlength(f"{shown}…", font) > width:
        shown = shown[:-1]
    return f"{shown.rstrip()}…"


def _mark(
    pen: ImageDraw.ImageDraw,
    x: float,
    y: float,
    size: float,
    tone: str,
    colour: tuple[int, int, int],
) -> None:
    """A check or a cross around a place."""
    wide = round(size / 2.5)
    if tone == "good":
        pen.line(
            [(x - size, y), (x - size / 3, y + 0.7 * size), (x + size, y - 0.8 * size)],
            colour,
            wide,
            "curve",
        )
    elif tone == "bad":
        for side in (-1, 1):
            pen.line([(x - size, y - side * size), (x + size, y + side * size)], colour, wide)
