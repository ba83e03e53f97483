"""Document: the content of the page as Markdown, with stills."""

from __future__ import annotations

from html import escape
from typing import Any, Final

PICTURES: Final = "../web/paper"
"""Directory of the stills, relative to the document."""
STILL_WIDTH_PX: Final = 200
"""Displayed width of each picture in the document with the paper's experiments, in pixels."""
INTRODUCTION: Final = """\
# The paper's experiments, run again

*Folding Arbitrary 3D Shapes with Space Filling Chain Robots: Reverse Explosion Approach to Folding
Sequence Design* describes about a dozen folds. We ran these folds again, some of them with two
settings, and most with `--preset paper`: the published method with the published numbers. This page
compares our results with those of the paper. *Verified (simulated)* means that the fold was
simulated with contacts, and that a clearance between all modules that are not linked was proved.

`make reproduction` runs the experiments that have no results yet, and then writes this page and the
page `/paper`, which plays the films of all experiments. In the pictures, red shows joint error, and
orange marks the modules at which a fold fails.
"""


def document(page: dict[str, Any]) -> str:
    """Return the Markdown of the values that ``page_text.told`` returns."""
    parts = [
        INTRODUCTION,
        page["lead"],
        *_list(page["summary"]),
        _markdown_rows(
            ["Experiment", "In the paper", "Here"],
            [[row["heading"], row["published"], row["here"]] for row in page["overview"]],
        ),
        page["machine"],
    ]
    for section in page["sections"]:
        parts += _section(section, page["head"])
    ode = page["ode"]
    parts += [f"## {ode['heading']}", *ode["words"], _figures(ode["head"], ode["rows"])]
    parts += [
        "## Values and their sources",
        "This table lists the numbers of `--preset paper`. Each number can be set by name, as in "
        "`--set damping=0.05 --set radial_gain=0.2`; "
        "[decision 0002](decisions/0002-published-preset.md) describes how these numbers were "
        "found.",
        _markdown_rows(
            ["Parameter", "Name", "Value", "From", "Meaning"],
            [
                [
                    row["label"],
                    f"`{row['name']}`",
                    row["value"],
                    row["source"],
                    row["meaning"],
                ]
                for row in page["settings"]
            ],
        ),
        "## Differences from the paper",
        *_list(page["differences"]),
    ]
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def _section(section: dict[str, Any], head: list[dict[str, str]]) -> list[str]:
    quote = section["quote"] and f"> {section['quote']}\n>\n> {section['where']}"
    strips = [
        _image(f"{card['id']}/strip", f"{card['title']}: unfolding above, folding below", 720)
        for card in section["cards"]
        if card["strip"]
    ]
    straight = [
        _image(f"{card['id']}/straight", f"{card['title']}, straight")
        for card in section["cards"]
        if card["straight"]
    ]
    stills = [
        _image(f"{card['id']}/still", f"{card['title']}: {card['verdict']}")
        for card in section["cards"]
        if card["film"]
    ]
    failed = [f"{card['title']}: {card['why']}." for card in section["cards"] if card["why"]]
    return [
        f"## {section['heading']}",
        quote,
        f"{section['words']} {section['found']}",
        "\n".join(strips),
        "\n".join([*straight, *stills]),
        *_list(failed),
        _figures(head, section["rows"]),
    ]


def _figures(head: list[dict[str, str]], rows: list[list[str]]) -> str:
    """Return a table whose columns have a name and a unit."""
    columns = ["<br>".join(filter(None, [column["name"], column["unit"]])) for column in head]
    return _markdown_rows(columns, rows)


def _image(name: str, alt: str, width: int = STILL_WIDTH_PX) -> str:
    return f'<img src="{PICTURES}/{name}.webp" alt="{escape(alt)}" width="{width}">'


def _list(lines: list[str]) -> list[str]:
    return ["\n".join(f"- {line}" for line in lines)] if lines else []


def _markdown_rows(head: list[str], rows: list[list[str]]) -> str:
    def line(cells: list[str]) -> str:
        return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"

    return "\n".join([line(head), line(["---"] * len(head)), *(line(row) for row in rows)])
