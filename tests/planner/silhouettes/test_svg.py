import pytest

from foldback.planner.errors import InputError
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.readers import read
from tests.planner.silhouettes.fronts import front

RING = '<path d="M1 1h4v4h-4zM2 2v2h2v-2z"/>'
NAMESPACES = 'xmlns="http://www.w3.org/2000/svg" xmlns:x="http://www.w3.org/1999/xlink"'


def drawing(content: str, *, prolog: str = "", box: str = "0 0 6 6") -> bytes:
    return f'{prolog}<svg {NAMESPACES} viewBox="{box}">{content}</svg>'.encode()


@pytest.mark.parametrize(
    "data",
    [
        drawing(RING),
        drawing(RING, prolog='<?xml version="1.0"?><!DOCTYPE svg PUBLIC "-//W3C//DTD" "a.dtd">\n'),
        drawing(f'<rect width="6" height="6" fill="#fff"/><g fill="navy">{RING}</g>'),
        drawing(
            f'<defs><g id="r">{RING}</g></defs><a x:href="https://x.org"><use x:href="#r"/></a>'
        ),
        drawing(RING, box="0 0 6e8 6e8").replace(
            RING.encode(), b'<g transform="scale(1e8)">' + RING.encode() + b"</g>"
        ),
    ],
)
def test_drawing_is_read_like_a_picture(data: bytes) -> None:
    preparation = prepare(data, "ring.svg", PathOptions(modules=96))
    assert front(preparation) == ["####", "#..#", "#..#", "####"]


def bomb(levels: int) -> str:
    groups = [
        f'<g id="g{k}">{"".join(f"""<use x:href="#g{k + 1}"/>""" for _ in range(10))}</g>'
        for k in range(levels)
    ]
    return f'<defs>{"".join(groups)}<g id="g{levels}">{RING}</g></defs><use x:href="#g0"/>'


ENTITIES = '<!DOCTYPE svg [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;">]>'


@pytest.mark.parametrize(
    ("data", "code"),
    [
        (drawing(f"<script>alert(1)</script>{RING}"), "active"),
        (drawing(f'<g onload="alert(1)">{RING}</g>'), "active"),
        (drawing(f"<foreignObject><p/></foreignObject>{RING}"), "active"),
        (drawing('<image x:href="/etc/passwd" width="6" height="6"/>'), "external"),
        (drawing('<image href="data:image/png;base64,AAAA" width="6" height="6"/>'), "external"),
        (drawing('<use href="https://example.org/a.svg#b"/>'), "external"),
        (
            drawing('<rect width="6" height="6" fill="url(http://example.org/a.svg#b)"/>'),
            "external",
        ),
        (drawing(f"<style>@import 'a.css';</style>{RING}"), "external"),
        (drawing(f"<style>rect {{ fill: u\\72l(a.svg#b) }}</style>{RING}"), "external"),
        (drawing(RING, prolog='<?xml-stylesheet href="a.css"?>'), "external"),
        (drawing("<text>&b;</text>", prolog=ENTITIES), "entities"),
        (drawing(bomb(12)), "too-large"),
        (drawing("<g>" * 300 + "</g>" * 300), "too-large"),
        (drawing("<g/>" * 60_000), "too-large"),
        (drawing(RING) + b" " * (8 << 20), "too-large"),
        (drawing(RING)[:-9], "damaged"),
        (drawing("<text y='3'>Anna</text>"), "empty"),
        (drawing(""), "empty"),
    ],
)
def test_active_external_or_huge_drawing_is_refused(data: bytes, code: str) -> None:
    with pytest.raises(InputError) as refusal:
        read(data, filename="drawing.svg")
    assert refusal.value.code == code


def test_drawing_that_refers_to_itself_is_read() -> None:
    loop = f'<g id="a">{RING}<use href="#a"/></g>'
    assert len(prepare(drawing(loop), "a.svg", PathOptions(modules=96)).chain) == 96


def test_text_of_a_drawing_is_noted() -> None:
    preparation = prepare(drawing(f"{RING}<text>Anna</text>"), "a.svg", PathOptions(modules=96))
    assert preparation.sentences == (
        "Text in the drawing is left out; convert it to paths to fold it.",
    )
