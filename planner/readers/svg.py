"""SVG: drawings, checked for anything that leads out of the file, then drawn as pixels by resvg."""

from __future__ import annotations

import re
from collections.abc import Mapping
from io import BytesIO
from typing import Any, Final
from xml.parsers import expat

from foldback.planner.errors import InputError
from foldback.planner.readers.limits import Source, megabytes, quote
from foldback.planner.readers.pixel_pictures import MAX_USED_SIDE, NO_LIBRARY, picture_of
from foldback.planner.silhouettes.picture import Picture

MAX_SVG_BYTES: Final = 8 << 20
"""Maximum size of an SVG file, in bytes; larger ones are refused."""
MAX_ELEMENTS: Final = 50_000
"""Maximum number of elements of a drawing, those counted repeatedly that others refer to: a drawing
of a few lines may otherwise stand for billions of elements."""
MAX_DEPTH: Final = 200
"""Maximum number of elements within each other; more are refused."""
PROBE_BYTES: Final = 8192
"""Number of bytes at the beginning of a file in which a drawing's first element is searched."""
ACTIVE_ELEMENTS: Final = ("script", "foreignobject", "iframe", "object", "embed", "handler")
PICTURE_ELEMENTS: Final = ("image", "feimage")
_URL: Final = re.compile(r"url\(\s*['\"]?\s*([^)'\"]*)", re.IGNORECASE)
_ROOT: Final = re.compile(rb"<(?:[\w.-]+:)?svg[\s/>]")


def is_svg(data: bytes) -> bool:
    """Return True if a text begins with the element of an SVG drawing."""
    start = data[:PROBE_BYTES].lstrip()
    root = _ROOT.search(start) if start.startswith(b"<") else None
    return root is not None and b"<html" not in start[: root.start()].lower()


def read_svg(data: bytes, source: Source) -> Picture:
    """Return the pixels of an SVG drawing.

    Raises:
        InputError: The drawing is damaged or too large, contains scripts, or refers to other files.
    """
    if len(data) > MAX_SVG_BYTES:
        raise InputError(
            "too-large",
            f"got an SVG drawing of {megabytes(len(data))}, expected at most "
            f"{megabytes(MAX_SVG_BYTES)}; simplify the drawing, or save it as PNG.",
        )
    drawing = _Drawing()
    drawing.check(data)
    try:
        from PIL import Image
        from resvg_py import svg_to_bytes
    except ImportError as error:
        raise InputError("no-library", NO_LIBRARY) from error
    try:
        # With both sides given, the drawing is fitted into the square.
        pixels = svg_to_bytes(
            svg_string=data.decode("utf-8", "replace"),
            skip_system_fonts=True,
            width=MAX_USED_SIDE,
            height=MAX_USED_SIDE,
        )
    except ValueError as error:
        raise _damaged(quote(str(error))) from error
    image = Image.open(BytesIO(pixels), formats=("PNG",))
    if image.getbbox() is None:
        remedy = "convert its text to paths" if drawing.has_text else "check the drawing's viewBox"
        raise InputError(
            "empty", f"nothing of the SVG drawing can be seen, expected filled shapes; {remedy}."
        )
    notes = (
        ("text in the drawing is left out; convert it to paths to fold it.",)
        if drawing.has_text
        else ()
    )
    return picture_of(image, source.name or "picture", notes=notes)


class _Drawing:
    """The elements of a drawing, checked while they are parsed.

    Attributes:
        has_text: True if it contains text, for which no fonts are used.
    """

    def __init__(self) -> None:
        self.has_text = False
        self._open: list[int] = []
        self._children: list[list[int]] = []
        self._references: list[list[str]] = []
        self._by_id: dict[str, int] = {}
        self._in_style = False

    def check(self, data: bytes) -> None:
        """Refuse a drawing that is damaged, too large, active, or refers to other files.

        Raises:
            InputError: Says which, and what to do.
        """
        parser = expat.ParserCreate(namespace_separator=" ")
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.CharacterDataHandler = self._characters
        parser.EntityDeclHandler = self._refuse_entities
        parser.ProcessingInstructionHandler = self._refuse_stylesheet
        try:
            parser.Parse(data, True)
        except expat.ExpatError as error:
            raise _damaged(quote(str(error))) from error
        if self._total() > MAX_ELEMENTS:
            raise _too_many()

    def _start(self, tag: str, attributes: Mapping[str, str]) -> None:
        number = len(self._children)
        if number >= MAX_ELEMENTS:
            raise _too_many()
        if len(self._open) >= MAX_DEPTH:
            raise InputError(
                "too-large",
                f"got more than {MAX_DEPTH} elements within each other; ungroup the drawing.",
            )
        if self._open:
            self._children[self._open[-1]].append(number)
        self._open.append(number)
        self._children.append([])
        self._references.append([])
        name = tag.rpartition(" ")[2].lower()
        if name in ACTIVE_ELEMENTS:
            raise _active(name)
        if name in PICTURE_ELEMENTS:
            raise InputError(
                "external",
                "the SVG drawing contains a picture, expected only shapes; remove the picture, or "
                "save the drawing as PNG.",
            )
        self.has_text = self.has_text or name == "text"
        self._in_style = name == "style"
        for key, value in attributes.items():
            self._check_attribute(name, key.rpartition(" ")[2].lower(), value)

    def _check_attribute(self, tag: str, name: str, value: str) -> None:
        if name.startswith("on"):
            raise _active(name)
        if name == "id":
            self._by_id.setdefault(value, self._open[-1])
        elif name == "href" and tag != "a":
            self._refer(value.strip())
        else:
            self._check_styles(value, is_style=name == "style")

    def _check_styles(self, text: str, *, is_style: bool) -> None:
        # In styles, a backslash may hide the letters of "url" or "@import".
        if is_style and ("@import" in text.lower() or "\\" in text):
            raise _external("a style sheet")
        for address in _URL.findall(text):
            self._refer(address.strip())

    def _refer(self, address: str) -> None:
        if not address.startswith("#"):
            raise _external(quote(address))
        self._references[self._open[-1]].append(address[1:])

    def _end(self, _tag: str) -> None:
        self._open.pop()
        self._in_style = False

    def _characters(self, text: str) -> None:
        if self._in_style:
            self._check_styles(text, is_style=True)

    def _refuse_entities(self, *_: Any) -> None:
        raise InputError(
            "entities",
            "the SVG drawing declares entities, which may stand for very long texts; save it as "
            "plain SVG.",
        )

    def _refuse_stylesheet(self, target: str, _text: str) -> None:
        if target == "xml-stylesheet":
            raise _external("a style sheet")

    def _total(self) -> int:
        """Return the number of elements, with those that others refer to at each reference."""
        totals: list[int | None] = [None] * len(self._children)
        # Children have larger numbers than their parents; references may go anywhere.
        stack: list[tuple[int, bool]] = [(0, False)] if totals else []
        running: set[int] = set()
        while stack:
            number, is_done = stack.pop()
            parts = [*self._children[number]]
            parts += [self._by_id[k] for k in self._references[number] if k in self._by_id]
            if is_done:
                running.discard(number)
                # A reference to an element around it counts nothing: resvg draws none.
                total = 1 + sum(totals[part] or 0 for part in parts)
                totals[number] = min(total, MAX_ELEMENTS + 1)
            elif totals[number] is None and number not in running:
                running.add(number)
                stack.append((number, True))
                stack += [(part, False) for part in parts]
        return (totals[0] or 0) if totals else 0


def _damaged(reason: str) -> InputError:
    return InputError(
        "damaged", f"the SVG drawing cannot be read ({reason}); save it again, or save it as PNG."
    )


def _active(name: str) -> InputError:
    return InputError(
        "active",
        f"the SVG drawing contains a program or foreign content ({quote(name)}), expected only "
        "shapes; save it as plain SVG.",
    )


def _external(address: str) -> InputError:
    return InputError(
        "external",
        f"the SVG drawing refers to {address} outside of the file, expected only shapes; save it "
        "as plain SVG, or as PNG.",
    )


def _too_many() -> InputError:
    return InputError(
        "too-large",
        f"the SVG drawing has more than {MAX_ELEMENTS} elements, counted with repetitions; "
        "simplify it, or save it as PNG.",
    )
