"""Twenty pictures: logos and silhouettes as SVG, PNG and JPEG, drawn for the benchmark."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

from foldback.planner.arrays import Array

SIDE = 480
"""Side of the pictures of pixels."""


def svg(content: str, box: str = "0 0 100 100") -> bytes:
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="{box}">{content}</svg>'.encode()


def regular(corners: int, radius: float, start: float = -90.0) -> Array:
    """Return the corners of a regular polygon around (50, 50)."""
    angles = np.radians(start + 360.0 * np.arange(corners) / corners)
    return 50.0 + radius * np.column_stack([np.cos(angles), np.sin(angles)])


def polygon(points: Array, attributes: str = "") -> str:
    listed = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
    return f'<polygon points="{listed}" {attributes}/>'


def star() -> bytes:
    points = np.empty((10, 2))
    points[::2], points[1::2] = regular(5, 48), regular(5, 21, -54.0)
    return svg(polygon(points))


def gear() -> bytes:
    teeth = "".join(
        f'<rect x="43" y="4" width="14" height="20" transform="rotate({angle} 50 50)"/>'
        for angle in range(0, 360, 45)
    )
    return svg(
        f'{teeth}<circle cx="50" cy="50" r="26" fill="none" stroke="#000" stroke-width="20"/>'
    )


def snowflake() -> bytes:
    arm = '<path d="M50 50V6M36 14l14 14 14-14"/>'
    arms = "".join(f'<g transform="rotate({angle} 50 50)">{arm}</g>' for angle in range(0, 360, 60))
    return svg(f'<g stroke="#036" stroke-width="7" fill="none">{arms}</g>')


ARROW = "M36 12h26l14 24 8-5-4 26-24-10 8-5-9-16h-11l-8 13-13-8z"
"""Third of a recycling symbol."""
SVGS: dict[str, Callable[[], bytes]] = {
    "star.svg": star,
    "gear.svg": gear,
    "snowflake.svg": snowflake,
    "heart.svg": lambda: svg(
        '<path d="M50 90L10 50a24 24 0 0 1 40-30a24 24 0 0 1 40 30z" fill="red"/>'
    ),
    "key.svg": lambda: svg(
        '<path fill-rule="evenodd" d="M5 30a20 20 0 0 1 38-6h52v12h-7v14h-12v-14h-6v10h-12v-10h-15'
        'a20 20 0 0 1-38-6zm12 0a9 9 0 0 0 18 0a9 9 0 0 0-18 0z"/>',
        "0 0 100 60",
    ),
    "note.svg": lambda: svg(
        '<path d="M38 14l46-8v12l-38 7v52z"/><path d="M38 14h9v60h-9zM75 8h9v54h-9z"/>'
        '<ellipse cx="33" cy="76" rx="15" ry="11"/><ellipse cx="70" cy="64" rx="15" ry="11"/>'
    ),
    "wifi.svg": lambda: svg(
        '<g fill="none" stroke="#000" stroke-width="11"><path d="M8 42a60 60 0 0 1 84 0"/>'
        '<path d="M26 60a34 34 0 0 1 48 0"/></g><circle cx="50" cy="82" r="10"/>'
    ),
    "recycling.svg": lambda: svg(
        "".join(f'<path transform="rotate({angle} 50 52)" d="{ARROW}"/>' for angle in (0, 120, 240))
    ),
    "face.svg": lambda: svg(
        '<rect width="100" height="100" fill="#fff"/><circle cx="50" cy="50" r="44" fill="#fb0"/>'
        '<g fill="#fff"><circle cx="34" cy="40" r="8"/><circle cx="66" cy="40" r="8"/>'
        '<path d="M24 60h52a27 24 0 0 1-52 0z"/></g>'
    ),
    "bars.svg": lambda: svg(
        '<rect x="5" y="60" width="22" height="35"/><rect x="39" y="35" width="22" height="60"/>'
        '<rect x="73" y="8" width="22" height="87"/>'
    ),
}


Draw = Callable[[ImageDraw.ImageDraw], None]


def drawn(draw: Draw, kind: str, figure: str, ground: str) -> bytes:
    """Return a picture of a figure that is drawn in white on black, in other colours."""
    mask = Image.new("L", (SIDE, SIDE), 0)
    draw(ImageDraw.Draw(mask))
    mask = mask.filter(ImageFilter.GaussianBlur(1.0))
    stream = BytesIO()
    if ground == "transparent":
        picture = Image.new("RGBA", mask.size, figure)
        picture.putalpha(mask)
    else:
        picture = Image.composite(
            Image.new("RGB", mask.size, figure), Image.new("RGB", mask.size, ground), mask
        )
    picture.save(stream, kind)
    return stream.getvalue()


def ring(draw: ImageDraw.ImageDraw) -> None:
    draw.ellipse((30, 30, 450, 450), outline=255, width=80)


def letter_b(draw: ImageDraw.ImageDraw) -> None:
    draw.rectangle((90, 40, 180, 440), fill=255)
    draw.ellipse((70, 40, 360, 250), outline=255, width=70)
    draw.ellipse((70, 210, 400, 440), outline=255, width=70)
    draw.rectangle((0, 0, 89, 480), fill=0)


def tree(draw: ImageDraw.ImageDraw) -> None:
    for top, width in ((30, 90), (130, 140), (240, 190)):
        draw.polygon([(240, top), (240 - width, top + 150), (240 + width, top + 150)], fill=255)
    draw.rectangle((205, 380, 275, 460), fill=255)


def cat(draw: ImageDraw.ImageDraw) -> None:
    draw.ellipse((110, 120, 370, 360), fill=255)
    draw.polygon([(120, 210), (110, 50), (220, 130)], fill=255)
    draw.polygon([(360, 210), (370, 50), (260, 130)], fill=255)
    draw.ellipse((170, 200, 210, 250), fill=0)
    draw.ellipse((270, 200, 310, 250), fill=0)
    draw.polygon([(225, 280), (255, 280), (240, 305)], fill=0)


def question(draw: ImageDraw.ImageDraw) -> None:
    draw.arc((120, 40, 360, 280), 180, 90, fill=255, width=64)
    draw.rectangle((208, 216, 272, 330), fill=255)
    draw.ellipse((200, 370, 280, 450), fill=255)


def dice(draw: ImageDraw.ImageDraw) -> None:
    draw.rounded_rectangle((40, 40, 440, 440), 60, fill=255)
    for x, y in ((140, 140), (340, 140), (240, 240), (140, 340), (340, 340)):
        draw.ellipse((x - 42, y - 42, x + 42, y + 42), fill=0)


def photo(seed: int, draw: Draw) -> bytes:
    """Return a JPEG of a dark figure before an uneven, noisy background, as a photo has one."""
    rng = np.random.default_rng(seed)
    mask = Image.new("L", (SIDE, SIDE), 0)
    draw(ImageDraw.Draw(mask))
    inside = np.asarray(mask.filter(ImageFilter.GaussianBlur(2.0))) / 255.0
    down, across = np.mgrid[0:SIDE, 0:SIDE] / SIDE
    ground = 235.0 - 60.0 * down - 25.0 * across
    shade = 60.0 + 35.0 * across
    pixels = ground * (1.0 - inside) + shade * inside + rng.normal(0.0, 9.0, inside.shape)
    stream = BytesIO()
    Image.fromarray(np.clip(pixels, 0, 255).astype(np.uint8)).save(stream, "JPEG", quality=60)
    return stream.getvalue()


def duck(draw: ImageDraw.ImageDraw) -> None:
    draw.ellipse((70, 210, 400, 420), fill=255)
    draw.ellipse((250, 70, 400, 220), fill=255)
    draw.rectangle((280, 150, 370, 280), fill=255)
    draw.polygon([(385, 120), (465, 150), (385, 180)], fill=255)
    draw.polygon([(70, 310), (30, 180), (170, 240)], fill=255)


def cup(draw: ImageDraw.ImageDraw) -> None:
    draw.rectangle((80, 110, 320, 400), fill=255)
    draw.ellipse((250, 160, 430, 340), outline=255, width=45)
    draw.rectangle((80, 110, 300, 400), fill=255)


PICTURES: dict[str, Callable[[], bytes]] = {
    **SVGS,
    "ring.png": lambda: drawn(ring, "PNG", "navy", "transparent"),
    "letter-b.png": lambda: drawn(letter_b, "PNG", "white", "transparent"),
    "tree.png": lambda: drawn(tree, "PNG", "darkgreen", "white"),
    "cat.png": lambda: drawn(cat, "PNG", "yellow", "black"),
    "question.png": lambda: drawn(question, "PNG", "red", "white"),
    "dice.jpg": lambda: drawn(dice, "JPEG", "black", "lightgrey"),
    "triangle.jpg": lambda: drawn(
        lambda draw: draw.regular_polygon((240, 240, 220), 3, fill=255), "JPEG", "orange", "white"
    ),
    "duck.jpg": lambda: photo(1, duck),
    "cup.jpg": lambda: photo(2, cup),
    "tree.jpg": lambda: photo(3, tree),
}
"""Bytes of a picture by the name of its file."""
