"""Purposes: what people want to do with a fold, and the one file for each."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple, TypedDict

from foldback.planner.twist_chains.folded_chains import is_coded
from foldback.words.fold import ShownFold

FileName = Literal["html", "mjcf", "trajectory", "leaflet", "stl", "npz"]
PurposeName = Literal["show", "simulate", "drive", "print", "cite", "check"]


class Purpose(TypedDict):
    """One purpose in words; ``href`` is the address of its file, None if it has none."""

    name: PurposeName
    heading: str
    text: str
    label: str
    href: str | None


class _Answer(NamedTuple):
    file: FileName
    text: str
    label: str


CITE: Final[Purpose] = {
    "name": "cite",
    "heading": "Cite it",
    "text": "A BibTeX entry with the permanent link, the date and the version.",
    "label": "BibTeX",
    "href": None,
}
_SHOW: Final = _Answer(
    "html", "A page that plays in any browser, without the internet.", "HTML page"
)
_SIMULATE: Final = _Answer(
    "mjcf",
    "The robot as a model for MuJoCo, with its shapes on the way as keyframes.",
    "MJCF model",
)
_DRIVE: Final = _Answer(
    "trajectory",
    "The angle and speed of each joint over time, at 1 rad/s at most.",
    "CSV table",
)
_CHECK: Final = _Answer(
    "npz",
    "The plan. Check it right here, or with: foldback verify FILE.",
    "NPZ plan",
)


def purposes_of(row: ShownFold, files: Mapping[FileName, str]) -> list[Purpose]:
    """Return the purposes for which a fold has a file; none if it has no files.

    Args:
        row: Facts of the fold.
        files: Addresses of the files that it has.
    """
    answers: dict[PurposeName, tuple[str, _Answer]] = {
        "show": ("Show it", _SHOW),
        "simulate": ("Simulate it", _SIMULATE),
        "drive": ("Drive motors", _DRIVE),
        "print": ("Print it", _print(row, files)),
        "check": ("Check it", _CHECK),
    }
    purposes: list[Purpose] = [
        {
            "name": name,
            "heading": heading,
            "text": answer.text,
            "label": answer.label,
            "href": files[answer.file],
        }
        for name, (heading, answer) in answers.items()
        if answer.file in files
    ]
    if purposes:
        purposes.insert(len(purposes) - ("npz" in files), CITE)
    return purposes


def _print(row: ShownFold, files: Mapping[FileName, str]) -> _Answer:
    """Return what to print: drawings for a puzzle that hands fold, one module of another chain."""
    if is_coded(row.module) and "leaflet" in files:
        return _Answer("leaflet", "Drawings of all steps, to fold it by hand.", "PDF leaflet")
    words = row.words
    return _Answer(
        "stl",
        f"One {words.singular} in millimetres, to be printed {row.modules} times; it has no "
        "joints or motors.",
        "STL solid",
    )
