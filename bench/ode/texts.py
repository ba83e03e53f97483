"""Texts: the stored comparison with the published algorithm on ODE, for README and /paper."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from bench.ode.comparison import OWN, Comparison, Row
from bench.reproduction.number_text import figure, whole

README: Final = Path(__file__).parents[2] / "README.md"
BEGIN, END = "<!-- ode -->\n", "<!-- end of ode -->\n"
METHODS: Final = {
    OWN: "foldback, three robots",
    "iterative": "published method on ODE, iterative solver",
    "direct": "published method on ODE, playback by the direct solver",
}
"""Name of each method."""
COLUMNS: Final = (
    ("Method", ""),
    ("Steps", "explosion + playback"),
    ("Processor time", "explosion + playback, seconds"),
    ("Relative time", "of both, × 1000 steps of MuJoCo"),
    ("Largest lag", "of a hinge behind its target, rad"),
    ("End error", "root mean square, pitches"),
    ("Joint gap", "largest in the playback, pitches"),
    ("Overlap", "deepest in the playback, pitches; modules 0.95 pitch wide"),
    ("Verified size", "of modules, pitches"),
)
"""Names and units of the columns on the page."""


def readme(text: str) -> str:
    """Return the README with a current table."""
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{readme_table(Comparison.load())}\n\n{END}{after}"


def readme_table(comparison: Comparison) -> str:
    """Return the comparison as a table in Markdown."""
    lines: dict[str, Callable[[Row], str]] = {
        "160-module wrench": lambda row: METHODS[row.id],
        "---": lambda _: "---",
        "steps of explosion and playback": lambda row: whole(
            row.explosion_steps + row.playback_steps
        ),
        "processor time of both": lambda row: f"{figure(row.explosion_s + row.playback_s)} s",
        "the same, relative to 1000 steps of the chain in MuJoCo": lambda row: figure(
            row.references
        ),
        "largest joint error of the playback": lambda row: f"{figure(row.lag_rad)} rad",
        "joints come apart by up to": lambda row: f"{figure(row.joint_gap)} pitch",
        "module size for which the fold is verified": _size,
    }
    rows = [comparison.row(name) for name in METHODS]
    return "\n".join(
        f"| {' | '.join([label, *(cell(row) for row in rows)])} |" for label, cell in lines.items()
    )


def page_section() -> dict[str, Any]:
    """Return the section of the page /paper, as plain JSON values."""
    comparison = Comparison.load()
    own, iterative, direct = (comparison.row(name) for name in METHODS)
    about = comparison.machine
    ratios = [figure(row.references / own.references) for row in (iterative, direct)]
    return {
        "id": "ode",
        "heading": "The wrench on the paper's physics engine",
        "words": [
            "For this comparison, we wrote the published method anew in C++ for the Open Dynamics "
            "Engine (ODE), the physics engine of the paper: equations 1 to 3, the rule of the "
            "playback, and the values in the last table of this page. Both methods folded the same "
            "chain on the same machine, one after the other. The published method folds the "
            "planned robot, foldback three robots that differ from it.",
            "The paper does not say how ODE solved the forces. Its iterative solver, here with "
            "the default of 20 iterations, is fast but does not hold the joints together: in the "
            "playback, modules overlap, even with ten steps for each snapshot, which gives about "
            "as many steps as in the paper. Its direct solver holds them together with one step "
            "for each snapshot, but each step takes about a hundred times as long. So we used it "
            "for the playback only.",
            f"The published method takes {ratios[0]} times as long as foldback with the "
            f"iterative solver, and {ratios[1]} times as long with the direct one.",
            f"Measured on {about['processor']}, one core. The unit of the relative time is the "
            f"time of 1000 steps of the straight chain in MuJoCo, {about['reference_seconds']:.2f} "
            "s at the beginning.",
        ],
        "head": [{"name": name, "unit": unit} for name, unit in COLUMNS],
        "rows": [_page_row(comparison.row(name)) for name in METHODS],
    }


def _page_row(row: Row) -> list[str]:
    return [
        METHODS[row.id],
        f"{whole(row.explosion_steps)} + {whole(row.playback_steps)}",
        f"{figure(row.explosion_s)} + {figure(row.playback_s)}",
        figure(row.references),
        figure(row.lag_rad),
        figure(row.end_error),
        figure(row.joint_gap),
        figure(row.overlap),
        _size(row),
    ]


def _size(row: Row) -> str:
    return "none" if row.size is None else f"{row.size:g}"
