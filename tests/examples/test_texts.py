"""List of all texts: the texts for people in each kind of file."""

import shutil
from pathlib import Path

from docs.make_texts import READERS, ROOT, all_texts, is_for_people
from tests.case import case


def test_reader_finds_texts_and_no_comments() -> None:
    for suffix, source, texts in (
        (".py", '"""Module."""\nx = f"got {x}, " "expected y"\ny = "key"', ["got {…}, expected y"]),
        (".py", '@app.get("/a")\ndef a():\n    """Return a."""', ["Return a."]),
        (".html", '<p title="A tip">Hello <b>you</b></p>', ["A tip", "Hello", "you"]),
        (".js", '// "no"\nf(`All ${n ? "big ones" : ""}`, "a " + "b");', ["All {…}", "a b"]),
        (
            ".md",
            "# Title\n\nOne line\nmore. Two.\n```\ncode here\n```\n- An item\n| a row | b. C |\n",
            ["# Title", "One line more.", "Two.", "- An item", "| a row | b. C |"],
        ),
    ):
        with case((suffix, source)):
            responses = {" ".join(words.split()) for _, words in READERS[suffix](source)}
            assert set(texts) <= responses
            assert not {"no", "Module.", "code here"} & responses


def test_joined_literals_of_a_script_keep_the_lines_of_those_after_them() -> None:
    source = 'f(`All ${n}` +\n  ` of them`);\nf("next");'
    assert list(READERS[".js"](source)) == [(1, "All {…} of them"), (3, "next")]


def test_texts_for_people_are_told_from_code() -> None:
    for words, expected in (
        ("the angles do not match the hinges", True),
        ("chain-end and chain-start are equal", True),
        ('<img src="a.webp" alt="A cup of 24" width="200">', True),
        ("<b>Two words</b>", True),
        ("private, no-cache", False),
        ("icon-button dialog-close", False),
        ("int32 sec uint32 nanosec", False),
        ("MSG: std_msgs/Header builtin_interfaces/Time stamp", False),
        ('<option gravity="0 0 0"><flag autoreset="disable"/></option>', False),
        ('<iframe src="{…}/embed/{…}" title="{…}" loading="lazy"></iframe>', False),
    ):
        with case(words):
            assert is_for_people(words) == expected


def test_all_texts_name_a_line_that_holds_the_text(tmp_path: Path) -> None:
    page = tmp_path / "web" / "templates" / "my_folds.html"
    page.parent.mkdir(parents=True)
    shutil.copyfile(ROOT / page.relative_to(tmp_path), page)
    texts = all_texts(tmp_path)
    assert any(text.words == "My folds" for text in texts)
