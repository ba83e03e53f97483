"""Leaflets: pages of the PDF, the HTML file by itself, and what the drawings show."""

import re
import zlib
from collections import Counter
from html.parser import HTMLParser
from itertools import combinations, pairwise
from xml.etree import ElementTree

import numpy as np
import pytest

from foldback.planner.chain.built_in_modules import CUBE
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.exports import leaflet
from foldback.planner.exports.formats import export_named
from foldback.planner.exports.step_drawing import (
    INKS,
    MAX_SMALL_WIDTH_PITCH,
    Drawing,
    Shape,
    draw_shape,
    draw_step,
)
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.steps import steps_between, steps_of
from foldback.planner.readers.angle_strings import read_angle_string
from tests.planner.chains import coil, line
from tests.planner.plans import resting, turn_by_turn

RING = read_angle_string("- - - + - - - + - - -", name="ring")


def plan_of(chain: Chain, at_once: int = 1) -> Plan:
    return resting(chain, turn_by_turn(chain, at_once))


@pytest.mark.parametrize(
    ("name", "size"), [("leaflet", (595.28, 841.89)), ("leaflet-letter", (612.0, 792.0))]
)
def test_pdf_has_a_page_for_six_steps_and_is_the_same_each_time(
    name: str, size: tuple[float, float]
) -> None:
    plan = plan_of(RING)
    data = export_named(name).write(plan)
    assert data == export_named(name).write(plan)
    assert data.startswith(b"%PDF-")
    assert len(re.findall(rb"/Type /Page\b", data)) == 1 + -(-11 // 6)
    boxes = re.findall(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", data)
    np.testing.assert_allclose(np.array(boxes, float), [size] * 3, atol=0.01)
    pages = [text for text in streams_of(data) if b"Page" in text]
    assert [re.findall(rb"\((Page[^)]*)\)", text) for text in pages] == [
        [f"Page {number} of 3".encode()] for number in (1, 2, 3)
    ]
    assert [text.count(b"Hold") for text in pages[1:]] == [6, 5]
    assert all(text.count(b"\nn ") > 5 * 12 for text in pages[1:])  # faces of twelve modules a step


def streams_of(data: bytes) -> list[bytes]:
    """Return all streams of a PDF file, unpacked."""
    starts = [match.end() for match in re.finditer(rb">>\s*stream\r?\n", data)]
    return [zlib.decompressobj().decompress(data[start:]) for start in starts]


def test_many_steps_are_drawn_small() -> None:
    few_leaflet, many_leaflet = (
        leaflet.leaflet_of(plan_of(coil(12))),
        leaflet.leaflet_of(plan_of(coil(40))),
    )
    assert len(few_leaflet.steps) <= leaflet.MAX_LARGE_STEPS < len(many_leaflet.steps)
    assert (few_leaflet.layout, many_leaflet.layout) == ((2, 3), (3, 4))
    drawings = [step.drawing for step in few_leaflet.steps]
    fewer = [leaflet.layout_of(drawings[:count]) for count in (1, 2, 3, 5)]
    assert fewer == [(1, 1), (2, 1), (2, 2), (2, 3)]


def test_drawings_of_long_chains_are_as_high_as_a_page() -> None:
    for width, height, layout in ((50, 20, (2, 3)), (20, 120, (2, 1)), (120, 20, (1, 1))):
        frame = ((0.0, 0.0), (width, 0.0), (width, height), (0.0, height))
        drawing = Drawing(shapes=(Shape(style="held-1", points=frame),), eye=0)
        assert leaflet.layout_of([drawing] * 6) == layout


def test_numbers_of_close_joints_do_not_cover_each_other() -> None:
    rests = np.zeros((2, 2 * 59))
    rests[1, [*range(2, 22, 2), 2 * 52]] = np.pi / 2
    (step,) = steps_between(CUBE, rests)
    poses = line(60).folded_poses
    labels = [shape for shape in draw_step(CUBE, step, poses).shapes if shape.style == "label"]
    numbers = {shape.text: shape for shape in labels if shape.text.isdigit()}
    assert list(numbers) == [str(turn.module + 1) for turn in step.turns]
    growth = 59 * np.sqrt(0.5) / MAX_SMALL_WIDTH_PITCH  # the drawing is scaled down by it
    for first, second in combinations(numbers.values(), 2):
        across, down = np.abs(np.subtract(first.points[0], second.points[0]))
        assert down >= 0.4 * growth or across >= 0.29 * growth or first.ends != second.ends


class Page(HTMLParser):
    """Tags, attributes and drawings of an HTML page."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: Counter[str] = Counter()
        self.attributes: set[str] = set()
        self.feed(text)
        self.drawings = [
            ElementTree.fromstring(svg) for svg in re.findall(r"<svg.*?</svg>", text, re.DOTALL)
        ]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        self.attributes |= {name for name, _ in attrs}


def test_html_needs_no_scripts_and_nothing_from_elsewhere() -> None:
    plan = plan_of(RING, at_once=4)
    text = export_named("leaflet-html").write(plan).decode()
    page = Page(text)
    assert not {"script", "link", "img", "iframe", "object"} & set(page.tags)
    assert not {"src", "href", "onload"} & page.attributes
    assert "url(" not in text
    assert "default-src 'none'" in text and "form-action 'none'" in text
    steps = len(steps_of(plan).steps)
    assert len(page.drawings) == 1 + steps + len(leaflet.LEGEND)
    # A leaflet lists all turns of merged steps.
    assert text.count("°") == 11
    assert "turn there together and evenly" in text


def test_the_moving_part_is_dark_the_held_part_light_and_the_joint_numbered() -> None:
    rests = np.zeros((2, 2 * 6))
    rests[1, 2 * 1] = np.pi / 2  # of 8 cubes, the first three turn at the third
    (step,) = steps_between(CUBE, rests)
    drawing = draw_step(CUBE, step, line(8).folded_poses)
    faces = Counter(shape.style.partition("-")[0] for shape in drawing.shapes)
    # Of a straight row, each cube has two free visible faces, and one end a third one.
    assert faces["moving"] + faces["held"] == 2 * 8 + 1
    assert abs(faces["moving"] - 2 * 3) <= 1
    assert [shape.text for shape in drawing.shapes if shape.style == "label"] == ["3"]
    assert (faces["arrow"], faces["head"], faces["axis"]) == (1, 1, 1)
    tones = {part: [INKS[f"{part}-{k}"].fill for k in range(3)] for part in ("moving", "held")}
    assert max(tone or 1 for tone in tones["moving"]) < min(tone or 0 for tone in tones["held"])


@pytest.mark.parametrize(("hinge", "angle"), [(2, 1), (2, -1), (3, 1), (3, -1), (8, 1), (9, -1)])
def test_an_arrow_points_to_where_the_end_goes(hinge: int, angle: int) -> None:
    folded = np.zeros(2 * 6)
    folded[hinge] = angle * np.pi / 2
    chain = Chain.from_angles(CUBE, folded)
    plan = resting(chain, np.array([np.zeros_like(folded), folded]))
    steps = steps_of(plan)
    (step,), (before, after) = steps.steps, steps.poses()
    drawing = draw_step(CUBE, step, before)
    end = "first" if step.moving == ((0, step.turns[0].module),) else "last"
    (joint,), (tip, *_) = points_of(drawing, "joint"), points_of(drawing, "head")
    (goal,) = points_of(draw_shape(CUBE, after, drawing.eye), end)
    along, expected = np.array(tip) - joint, np.array(goal) - joint
    assert along @ expected > 0.95 * np.linalg.norm(along) * np.linalg.norm(expected)


def points_of(drawing: Drawing, style: str) -> tuple[tuple[float, float], ...]:
    (shape,) = [shape for shape in drawing.shapes if shape.style == style]
    return shape.points


def test_long_straight_ends_are_cut_short() -> None:
    rests = np.zeros((2, 2 * 58))
    rests[1, 2 * 19] = np.pi / 2  # of 60 cubes, at the 21st
    (step,) = steps_between(CUBE, rests)
    drawing = draw_step(CUBE, step, line(60).folded_poses)
    texts = [shape.text for shape in drawing.shapes if shape.style == "label"]
    assert texts == ["14 more to 1", "32 more to 60", "21"]


def test_a_hidden_joint_is_seen_from_another_side() -> None:
    drawn = leaflet.leaflet_of(plan_of(coil(40))).steps
    eyes = [step.drawing.eye for step in drawn]
    assert len(set(eyes)) > 1
    # The view changes only where the leaflet says so.
    turned_flags = [step.text.endswith("Seen from another side.") for step in drawn]
    assert turned_flags == [a != b for a, b in pairwise([0, *eyes])]


def test_leaflets_of_too_many_steps_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(leaflet, "MAX_DRAWN_MODULES", 12 * 10)
    with pytest.raises(InputError, match="got 11 steps of 12 modules"):
        export_named("leaflet").write(plan_of(RING))
