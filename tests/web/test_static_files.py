"""Scripts as browsers get them: without comments, only those that a page needs, and their types."""

import re
from difflib import SequenceMatcher

from docs.make_api_types import FILE, types
from foldback.web.static_files import STATIC, code_of, scripts_of, text_of
from tests.case import case

SCRIPTS = sorted(path.relative_to(STATIC).as_posix() for path in STATIC.rglob("*.js"))
MAX_SCRIPTS = {"compare": 22, "editor": 7, "embed": 25, "fold": 34, "landing": 17, "preview": 10}
"""Maximum number of scripts that a page loads at once. Each is a request; with data, styles and
pictures, more of them would exceed the limit of ``make bench`` (weights) for the page."""
TYPE = re.compile(r"/\*\* @.*?\*/ ?")
"""Type annotation within a line of code."""


def test_scripts_lose_only_comments() -> None:
    for name in SCRIPTS:
        with case(name):
            untyped = ((line, TYPE.sub("", line)) for line in text_of(name).splitlines())
            lines = [code if code.strip() else line for line, code in untyped]
            kept_lines = code_of(name).splitlines()
            removed_lines: list[str] = []
            inside = False
            for change_kind, start, end, second, last in SequenceMatcher(
                None, lines, kept_lines, autojunk=False
            ).get_opcodes():
                assert change_kind in ("equal", "delete"), lines[start:end]
                removed_lines += lines[start:end] if change_kind == "delete" else []
                if change_kind == "delete":
                    assert not inside, f"a text over several lines: {lines[start]}"
                for line in kept_lines[second:last]:
                    inside ^= len(re.findall(r"(?<!\\)`", line)) % 2 == 1
            comment = re.compile(r"\s*(//|/\*\*|\*)")
            assert all(comment.match(line) for line in removed_lines), removed_lines
            assert inside or not any(re.match(r"\s*(//|/\*\*)", line) for line in kept_lines)


def test_scripts_of_a_page_are_imported_at_once_or_later() -> None:
    at_once = scripts_of("js/pages/fold.js", later=False)
    all_of_them = scripts_of("js/pages/fold.js")
    assert {"js/player/player.js", "js/panels/plots.js"} <= set(at_once)
    assert "js/panels/downloads.js" in set(all_of_them) - set(at_once)
    assert at_once[0] == all_of_them[0] == "js/pages/fold.js"
    # Imports of types load nothing.
    assert scripts_of("js/panels/failure.js") == (
        "js/panels/failure.js",
        "js/lib/text.js",
        "js/viewer/viewpoint.js",
        "js/viewer/camera.js",
    )


def test_page_loads_no_more_scripts_at_once_than_its_requests_allow() -> None:
    for name, maximum in MAX_SCRIPTS.items():
        assert len(scripts_of(f"js/pages/{name}.js", later=False)) <= maximum, name


def test_types_of_answers_are_those_of_the_description() -> None:
    assert types() == FILE.read_text(encoding="utf-8"), "run `python -m docs.make_api_types`"
