"""Write the texts derived from a fold's options: the rows in api.md and the client's types.

A test fails if one of them is outdated; run ``python -m docs.make_options`` then.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from foldback.planner.parameters.option import Option, options_of
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.request import FoldRequest

ROOT: Final = Path(__file__).parents[1]
PAGE: Final = ROOT / "docs" / "api.md"
CLIENT: Final = ROOT / "client" / "options.py"
BEGIN, END = "<!-- options -->\n", "<!-- end of options -->\n"
PREVIEW_OPTIONS: Final = (*options_of(PathOptions), "seed")
"""Names of the options that previews also accept."""
HEAD: Final = '''"""Options of folds and previews, written by ``docs/make_options.py``."""

from __future__ import annotations

from typing import Literal, TypedDict


'''


def markdown_rows(request: type[Any] = FoldRequest) -> str:
    """Return the options as rows in Markdown, one per line."""
    lines = ["| option | values | default | meaning |", "|---|---|---|---|"]
    for name, option in options_of(request).items():
        meaning = (option.meaning or f"{option.title}.").replace("|", "\\|")
        default = "–" if option.default in (None, "") else f"`{_text(option.default)}`"
        lines.append(f"| `{name}` | {_values(option)} | {default} | {meaning} |")
    return "\n".join(lines) + "\n"


def page(text: str, request: type[Any] = FoldRequest) -> str:
    """Return a page with current rows."""
    before, _, page_end = text.partition(BEGIN)
    _, _, after = page_end.partition(END)
    return f"{before}{BEGIN}\n{markdown_rows(request)}\n{END}{after}"


def client_types(request: type[Any] = FoldRequest) -> str:
    """Return the module with the client's types."""
    options = options_of(request)
    previews = {name: option for name, option in options.items() if name in PREVIEW_OPTIONS}
    folds = {name: option for name, option in options.items() if name not in PREVIEW_OPTIONS}
    return HEAD + "\n\n".join(
        (
            _typed_dict("PreviewOptions", "Options that turn a shape into a chain.", previews),
            _typed_dict("PlanOptions", "Options of a fold that its preview has not.", folds),
        )
    )


def _typed_dict(name: str, text: str, options: Mapping[str, Option]) -> str:
    lines = [f"class {name}(TypedDict, total=False):", f'    """{text}"""', ""]
    lines += [f"    {key}: {_type(option)}" for key, option in options.items()]
    return "\n".join(lines) + "\n"


def _type(option: Option) -> str:
    """Return the type of an option's values in Python."""
    if option.choices:
        names = ", ".join(f'"{name}"' for name in option.choices)
        return f"Literal[{names}]"
    return option.kind.__name__ if isinstance(option.kind, type) else str(option.kind)


def _values(option: Option) -> str:
    """Return the values of an option in words."""
    if option.choices:
        return ", ".join(f"`{name}`" for name in option.choices)
    if option.range is not None:
        low, high = option.range
        limits = f"{low} to {high}" if option.kind is int else f"{low:g} to {high:g}"
        return f"{limits} {option.unit}".rstrip()
    if option.kind is bool:
        return "`true`, `false`"
    return f"`{option.metavar.lower()}`" if option.metavar else "text"


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


if __name__ == "__main__":
    PAGE.write_text(page(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    CLIENT.write_text(client_types(), encoding="utf-8")
