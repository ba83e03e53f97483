"""Path reasons: why a shape has no path, or not the requested one, as a code, values and a text."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Final, TypedDict, cast

from foldback.planner.pathfinding import Cell


class PathCode(StrEnum):
    """Code of a reason."""

    # Proofs that no path visits all cells.
    TOO_FEW = "too-few"
    DISCONNECTED = "disconnected"
    PARITY = "parity"
    UNEVEN_PART = "uneven-part"
    DEAD_ENDS = "dead-ends"
    CUT_CELLS = "cut-cells"
    ARMS = "arms"
    ENDS = "ends"
    NO_PATH = "no-path"
    # Searches, and the requested ends of a path.
    START_INSIDE = "start-inside"
    START_COLOUR = "start-colour"
    ENDS_COLOUR = "ends-colour"
    NO_PATH_WITH_ENDS = "no-path-with-ends"
    NO_SURFACE_ENDS = "no-surface-ends"
    NOT_STARTED = "not-started"
    START_SHARES_HINGES = "start-shares-hinges"
    GIVEN_MODULES = "given-modules"
    GIVEN_CELLS = "given-cells"
    UNDECIDED = "undecided"
    TIME_LIMIT = "time-limit"
    FEW_PATHS = "few-paths"
    NO_ASSEMBLY = "no-assembly"
    NO_BOX = "no-box"
    SNAKE_START = "snake-start"
    NO_BLOCKS = "no-blocks"
    # Shapes on a table.
    ONE_FLOOR_CELL = "one-floor-cell"
    TIPS_OVER = "tips-over"
    ALMOST_TIPS_OVER = "almost-tips-over"
    OVERHANG = "overhang"
    PARTS = "parts"
    HAIRPINS_ONLY = "hairpins-only"
    NO_ASCENDING_PATH = "no-ascending-path"
    UNDECIDED_ON_TABLE = "undecided-on-table"
    # Rules of a path for a table, which a given path breaks.
    FIRST_LINK = "first-link"
    BOXED_IN = "boxed-in"
    GOES_DOWN = "goes-down"
    HAIRPIN = "hairpin"
    NOT_STABLE = "not-stable"


class PathValues(TypedDict, total=False):
    """Values of a reason; lengths in module widths, cells as (x, y, z).

    Attributes:
        count, minimum: Number of affected cells, and the smallest number that is allowed.
        parts, largest: Number of separate parts, and the number of cells in the largest one.
        black, white: Numbers of cells of each colour of a chessboard.
        arms: Number of arms of a part.
        around, places, needed, allowed: See ``planner.pathfinding.end_proofs.EndProof``.
        cell, other_cell: A cell, and a second one.
        ends: The two ends of the given order of cells.
        limit_s: Time limit of a search, s.
        paths, requested: Number of paths that were found, and of requested ones.
        margin, min_margin: Distance of the centre of mass inside the edge of the base, negative
            outside, and the required one.
        layers: Number of lowest layers that tip over; absent for the whole shape.
        further: Number of longer parts that are affected, too.
        layer: Layer that the reason is about, counted from 1 at the bottom; absent for the shape.
        found: True if the reason is about a path that a search found.
        falls: True if the reason also holds for paths that go down.
        proved: True if a search was complete.
    """

    count: int
    minimum: int
    parts: int
    largest: int
    black: int
    white: int
    arms: int
    around: int
    places: int
    needed: int
    allowed: int
    cell: Cell
    other_cell: Cell
    ends: tuple[Cell, Cell]
    limit_s: float
    paths: int
    requested: int
    margin: float
    min_margin: float
    layers: int
    further: int
    layer: int
    found: bool
    falls: bool
    proved: bool


class PathReasonFigures(TypedDict):
    """``PathReason`` as plain JSON values."""

    code: str
    values: PathValues


@dataclass(frozen=True, slots=True)
class PathReason:
    """Reason as a value: a code, and the values that its text names."""

    code: PathCode
    values: PathValues

    @classmethod
    def of(cls, code: PathCode, **values: Any) -> PathReason:
        """Return a reason with these values, see ``PathValues``."""
        return cls(code, cast(PathValues, values))

    def with_values(self, **values: Any) -> PathReason:
        """Return the reason with more values."""
        return PathReason(self.code, cast(PathValues, {**self.values, **values}))

    def as_dict(self) -> PathReasonFigures:
        """Return plain JSON values."""
        return {"code": str(self.code), "values": self.values}

    @property
    def text(self) -> str:
        """The reason as a phrase with a full stop."""
        before = ""
        if "layer" in self.values:
            before = f"layer {self.values['layer']} from the bottom: "
        if self.values.get("found"):
            before = "the search found a path, but the chain cannot follow it: "
        return before + TEXTS[self.code].format(**_words(self.values))

    @property
    def sentence(self) -> str:
        """The reason as a sentence."""
        return f"{self.text[:1].upper()}{self.text[1:]}"


def sentences(reasons: Iterable[PathReason]) -> str:
    """Return reasons as sentences."""
    return " ".join(reason.sentence for reason in reasons)


def counted(number: int, noun: str) -> str:
    """Return a number with a noun in the singular or the plural."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _words(values: PathValues) -> dict[str, Any]:
    """Return the values as texts, by name."""
    words: dict[str, Any] = {**values}
    if "count" in values:
        words["cells"] = counted(values["count"], "cell")
        words["connect"] = "connects" if values["count"] == 1 else "connect"
        words["links"] = 2 * values["count"]
    if "needed" in values:
        words["needed"] = counted(values["needed"], "end")
        words["end_limit"] = "A path has only two ends."
    if (allowed := values.get("allowed", 2)) < 2:
        words["end_limit"] = (
            "But a path alternates between the two colours of a chessboard, and because of the "
            f"numbers of both, {('no end', 'only one end')[allowed]} can have their colour."
        )
    if "ends" in values:
        words["ends"] = " or ".join(map(str, values["ends"]))
    if "margin" in values:
        words["outside"] = -values["margin"]
        words["subject"] = "the shape"
    if "layers" in values:
        layers = "layer" if values["layers"] == 1 else f"{values['layers']} layers"
        words["subject"] = f"a chain folds the lowest {layers} first, and this part"
    if further := values.get("further", 0):
        words["others"] = (
            f" {counted(further, 'longer section')} at the start of the path would tip over, too."
        )
    words.setdefault("others", "")
    words["no"] = "proved that there is no" if values.get("proved") else "found no"
    words["every"] = (
        "every path that starts flat on the floor"
        if values.get("falls")
        else "every path that starts on the floor and never goes down"
    )
    return words


TEXTS: Final = {
    PathCode.TOO_FEW: "got {cells}, expected at least {minimum}.",
    PathCode.DISCONNECTED: (
        "the cells are in {parts} parts that share no face; the largest has {largest} of {count} "
        "cells, and a chain cannot cross the gaps."
    ),
    PathCode.PARITY: (
        "if the cells are coloured like a chessboard, {black} are black and {white} are white; a "
        "path alternates between the colours, so the two numbers may differ by at most one."
    ),
    PathCode.UNEVEN_PART: (
        "one part of the shape is connected to the rest by a single cell. If the cells are "
        "coloured like a chessboard, this part has too many cells of one colour. A path alternates "
        "between the two colours, so it cannot visit all cells."
    ),
    PathCode.DEAD_ENDS: (
        "{cells} have only one neighbour. Such a cell must be an end of the path, and a path has "
        "two ends, so at most two such cells are possible."
    ),
    PathCode.CUT_CELLS: (
        "without one of its cells, the shape falls into {parts} parts. A path passes this cell "
        "only once, so it can visit at most two of these parts."
    ),
    PathCode.ARMS: (
        "one part of the shape has {arms} arms, each attached to this part by a single cell. A "
        "path cannot return from an arm, so it can visit at most two arms: one at its start, one "
        "at its end."
    ),
    PathCode.ENDS: (
        "{cells}, of which no two touch, share faces with only {around} others. A path joins each "
        "of the {count} to two of those, unless it ends there: {links} links. There is room for "
        "{places}: one on each shared face, at most two on each of the {around}. So {needed} of "
        "the path would lie among the {count} cells. {end_limit}"
    ),
    PathCode.NO_PATH: (
        "a complete search found no path. There is no simpler reason: the cells have neither too "
        "many ends nor too many of one colour."
    ),
    PathCode.START_INSIDE: (
        "the path must start on the surface, but the start cell is inside the shape. Choose a "
        "start cell on the surface."
    ),
    PathCode.START_COLOUR: (
        "imagine the cells coloured like a chessboard. A path through an odd number of cells must "
        "start on the colour that has more cells. The start cell has the other colour; start in a "
        "neighbouring cell."
    ),
    PathCode.ENDS_COLOUR: (
        "imagine the cells coloured like a chessboard. A path through an odd number of cells must "
        "start and end on the colour that has more cells. Both ends must also be on the surface, "
        "but the surface has fewer than two cells of this colour."
    ),
    PathCode.NO_PATH_WITH_ENDS: (
        "the search proved that no path with these ends visits every cell once."
    ),
    PathCode.NO_SURFACE_ENDS: "no path with both ends on the surface was found.",
    PathCode.NOT_STARTED: "no path that starts in the cell {cell} was found.",
    PathCode.START_SHARES_HINGES: (
        "the chain must start on the surface, but the start cell shares all its hinges with other "
        "cells; start in another cell."
    ),
    PathCode.GIVEN_MODULES: (
        "the file gives the order of the modules, so the chain's start cannot be chosen."
    ),
    PathCode.GIVEN_CELLS: (
        "the file gives the order of the cells, so the chain can start in {ends}, but not in "
        "{cell}. Read the cells as a shape to find other paths."
    ),
    PathCode.UNDECIDED: (
        "no path was found in {limit_s:g} s, but a path may exist; give the search more time, "
        "repair the shape, or split each cell into 2×2×2 cells."
    ),
    PathCode.TIME_LIMIT: "no path was found within the time limit.",
    PathCode.FEW_PATHS: "only {paths} of {requested} paths were found within the time limit.",
    PathCode.NO_ASSEMBLY: (
        "the search found no path along which the modules can leave the shape one after another. "
        "It finds such paths for boxes, for shapes made of 2×2×2 blocks, and for shapes whose "
        "layers each have one part. Use the method 'blocks' or 'exact', or choose other ends of "
        "the chain."
    ),
    PathCode.NO_BOX: (
        "the method 'snake' needs cells that fill a box, but the cells of this shape do not. Use "
        "the method 'blocks' or 'exact'."
    ),
    PathCode.SNAKE_START: (
        "a snake starts in a corner of its box; start in a corner or use another method."
    ),
    PathCode.NO_BLOCKS: (
        "the method 'blocks' found no path. Either the shape is not made of 2×2×2 blocks of cells, "
        "or the chosen ends are not possible. Split each cell into 2×2×2 cells, choose other ends, "
        "or use the method 'exact'."
    ),
    PathCode.ONE_FLOOR_CELL: (
        "only one cell touches the floor, but the first two modules must lie on the floor."
    ),
    PathCode.TIPS_OVER: (
        "{subject} would tip over: its centre of mass is {outside:.2g} spacings outside its base."
    ),
    PathCode.ALMOST_TIPS_OVER: (
        "{subject} would almost tip over: its centre of mass is {margin:.2g} spacings inside "
        "the edge of its base, but at least {min_margin:g} spacings are needed."
    ),
    PathCode.OVERHANG: (
        "{cells} with nothing below {connect} {parts} separate parts; a chain that never goes down "
        "cannot fold such a shape."
    ),
    PathCode.PARTS: (
        "it consists of {parts} separate parts; a chain that never goes down cannot leave a layer "
        "and come back."
    ),
    PathCode.HAIRPINS_ONLY: (
        "a chain on a table cannot turn back directly above itself, but {every} does so somewhere."
    ),
    PathCode.NO_ASCENDING_PATH: (
        "the search {no} path that starts on the floor and never goes down."
    ),
    PathCode.UNDECIDED_ON_TABLE: (
        "the search found no path that starts on the floor and never goes down, but such a path "
        "may exist."
    ),
    PathCode.FIRST_LINK: (
        "the path must start with two cells on the floor, but at least one of its first two cells "
        "is higher."
    ),
    PathCode.BOXED_IN: (
        "the cell {cell} is below an earlier cell and enclosed on all sides, but one side must be "
        "free, so that a module can reach the cell."
    ),
    PathCode.GOES_DOWN: (
        "the path goes down from the cell {cell} to the cell {other_cell}, but it must rise layer "
        "by layer."
    ),
    PathCode.HAIRPIN: (
        "the path turns back directly above itself between the cells {cell} and {other_cell}. On a "
        "table, a chain cannot make such a turn."
    ),
    PathCode.NOT_STABLE: (
        "the first {cells} of the path would tip over: their centre of mass must be at least "
        "{min_margin:g} spacings inside the edge of their base.{others}"
    ),
}
"""Text of each reason."""
