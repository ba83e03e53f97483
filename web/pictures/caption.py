"""Caption: the name and the verdict of a fold, written into its social picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from PIL import Image, ImageDraw, ImageFont

GOOD: Final = (30, 122, 60)
BAD: Final = (190, 24, 30)
QUIET: Final = (92, 96, 104)
INK: Final = (28, 31, 36)
PAPER: Final = (252, 251, 249)
HEIGHT: Final = 108
"""Pixels of the band at the bottom."""
BAND: Final = 84
"""Pixels of the red band at the top of the picture of a failed fold."""
LEFT: Final = 40
NAME_PX: Final = 44
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
    top = height - HEIGHT
    pen.rectangle((0, top, width, height), fill=PAPER)
    colour = {"good": GOOD, "bad": BAD}.get(caption.tone, QUIET)
    verdict = ImageFont.load_default(VERDICT_PX)
    right = width - LEFT - pen.textlength(caption.verdict, verdict)
    middle = top + HEIGHT / 2
    pen.text((right, middle), caption.verdict, colour, verdict, anchor="lm")
    _mark(pen, right - 44, middle, 14.0, caption.tone, colour)
    name = ImageFont.load_default(NAME_PX)
    pen.text((LEFT, middle), _fitting(pen, caption.name, name, right - 80 - LEFT), INK, name, "lm")
    if caption.tone != "bad":
        return
    pen.rectangle((0, 0, width, BAND), fill=BAD)
    pen.rectangle((0, 0, width - 1, height - 1), outline=BAD, width=10)
    _mark(pen, LEFT + 16, BAND / 2, 20.0, "bad", PAPER)
    pen.text((LEFT + 60, BAND / 2), "This fold failed", PAPER, name, anchor="lm")


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
