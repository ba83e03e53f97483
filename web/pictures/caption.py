"""Caption: texts that are written into pictures of a fold."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

from PIL import Image, ImageDraw, ImageFont

from foldback.planner.exports.export import FONT_FILE

VERIFIED_RGB: Final = (30, 122, 60)
FAILED_RGB: Final = (190, 24, 30)
DETAIL_RGB: Final = (92, 96, 104)
TEXT_RGB: Final = (28, 31, 36)
BAND_RGB: Final = (252, 251, 249)
DARK_RGB: Final = (24, 26, 30)
BAND_HEIGHT_PX: Final = 108
"""Height of the caption band at the bottom of a fold's preview picture for social networks, in
pixels."""
FAILED_BAND_PX: Final = 84
"""Height of the red band at the top of the preview picture of a failed fold, in pixels."""
SIDE_MARGIN_PX: Final = 40
"""Distance of a caption's text from the left and from the right edge of a preview picture, in
pixels."""


@dataclass(frozen=True, slots=True)
class Caption:
    """Caption of a picture.

    Attributes:
        name: Name of the fold.
        verdict: Verdict in a few words.
        tone: "good", "bad", or another word for a caption without a mark.
    """

    name: str
    verdict: str
    tone: str


def write_caption(picture: Image.Image, caption: Caption) -> None:
    """Draw a caption into an RGB picture; a failed fold also gets a red band with a cross."""
    pen = ImageDraw.Draw(picture)
    width, height = picture.size
    top = height - BAND_HEIGHT_PX
    pen.rectangle((0, top, width, height), fill=BAND_RGB)
    colour = {"good": VERIFIED_RGB, "bad": FAILED_RGB}.get(caption.tone, DETAIL_RGB)
    verdict = _font(30)
    right = width - SIDE_MARGIN_PX - pen.textlength(caption.verdict, verdict)
    middle = top + BAND_HEIGHT_PX / 2
    pen.text((right, middle), caption.verdict, colour, verdict, anchor="lm")
    _mark(pen, right - 44, middle, 14.0, caption.tone, colour)
    name = _font(44)  # a long name is drawn smaller
    pen.text(
        (SIDE_MARGIN_PX, middle),
        _fitting(caption.name, name, right - 80 - SIDE_MARGIN_PX),
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


@lru_cache(8)  # many pictures show the same caption
def caption_strip(text: str, *, width: int, height: int, dark: bool) -> Image.Image:
    """Draw a caption of a movie.

    Args:
        text: The caption.
        width: Width of the movie, pixels.
        height: Height of the movie, pixels.
        dark: True for light letters on a dark background.

    Returns:
        An RGBA picture as wide as the movie, for its lower edge.
    """
    size = max(11, round((1 / 26) * min(width, height)))  # smaller letters cannot be read
    font, margin, step = _font(size), size, round(1.35 * size)
    lines = _lines(text, font, width - 2 * margin)
    paper, ink = (DARK_RGB, BAND_RGB) if dark else (BAND_RGB, TEXT_RGB)
    tall = len(lines) * step + margin
    strip = Image.new("RGBA", (width, tall), (*paper, round(255 * 0.86)))
    pen = ImageDraw.Draw(strip)
    for k, line in enumerate(lines):
        pen.text((width / 2, (margin + step) / 2 + k * step), line, (*ink, 255), font, anchor="mm")
    return strip


@cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(FONT_FILE, size, layout_engine=ImageFont.Layout.BASIC)


@cache
def _drawn(letter: str) -> bytes:
    """Return the pixels of a letter; those of U+FFFF if the font lacks it."""
    picture = Image.new("L", (24, 24))
    ImageDraw.Draw(picture).text((4, 2), letter, 255, _font(16))
    return picture.tobytes()


def _known(text: str) -> str:
    """Return a text without the letters that the font lacks."""
    missing = _drawn("\uffff")
    return " ".join("".join(c for c in text if c == " " or _drawn(c) != missing).split())


def _lines(text: str, font: ImageFont.FreeTypeFont, width: float) -> list[str]:
    """Break a text into lines that fit a width, in pixels."""
    lines = [""]
    for word in _known(text).split(" "):
        longer = f"{lines[-1]} {word}".strip()
        if font.getlength(longer) <= width:
            lines[-1] = longer
        else:
            lines.append(word)
    lines = [line for line in lines if line]
    shown_lines = lines[:4]
    if len(lines) > len(shown_lines):
        shown_lines[-1] += " …"
    return [_fitting(line, font, width) for line in shown_lines]


def _fitting(text: str, font: ImageFont.FreeTypeFont, width: float) -> str:
    """Return as much of a text as fits a width. Letters that the font lacks are left out."""
    drawable_text = _known(text)
    if font.getlength(drawable_text) <= width:
        return drawable_text
    while drawable_text and font.getlength(f"{drawable_text}…") > width:
        drawable_text = drawable_text[:-1]
    return f"{drawable_text.rstrip()}…"


def _mark(
    pen: ImageDraw.ImageDraw,
    x: float,
    y: float,
    size: float,
    tone: str,
    colour: tuple[int, int, int],
) -> None:
    """Draw a check mark or a cross centred at (x, y)."""
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
