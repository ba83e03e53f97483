"""Names that show nothing or mislead are cleaned at every input."""

from typing import Any

import pytest

from foldback.planner.chain.display_names import MAX_NAME_LENGTH, clean_name
from foldback.planner.exports.export import export_name
from foldback.server.submission.fold_inputs import clean_filename
from tests.case import case
from tests.server.service_process import SNAKE, Service, bearer, path_file

INVISIBLE = {
    "Hangul fillers": "\u3164\uffa0",
    "Hangul initial and medial fillers": "\u115f\u1160",
    "Khmer inherent vowels": "\u17b4\u17b5",
    "Braille blank": "\u2800",
    "invisible signs": "\U0001d159\u2061\u2062\u2063\u2064\ufff9\ufffa\ufffb",
    "zero width": "\u200b\u200c\u200d\u2060\ufeff\u180e",
    "direction": "\u200e\u200f\u061c\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069",
    "soft hyphen": "\u00ad",
    "tags": "\U000e0001\U000e0041\U000e007f",
    "variation selectors": "\ufe00\ufe0f\U000e0100\U000e01ef\u180b\u180f",
    "combining marks alone": "\u0301\u0308\u20dd\u034f",
    "spaces": "\u00a0\u1680\u2003\u2009\u202f\u205f\u3000\u2028\u2029\t\n\r\x0b\x85",
    "control": "\x00\x07\x1b\x7f\x9b",
    "private use and unassigned": "\ue000\U000f0000\u0378\uffff",
    "surrogate": "\ud800",
}
"""Texts that are invisible."""


def test_clean_name_drops_invisible_text() -> None:
    for kind, text in INVISIBLE.items():
        with case(kind):
            assert clean_name(text) == clean_name(f" {text} {text}") == ""
            assert clean_name(f"{text}wrench{text.replace(chr(0x301), '')} 12").isprintable()
            assert clean_filename(f"a/{text}") is None
            assert export_name(text) == "fold"


def test_clean_name_keeps_visible_text() -> None:
    for name, clean in (
        ("a\u3164b", "ab"),
        ("exe\u202egpj.scr", "exegpj.scr"),
        ("a\u2003\u00a0 b", "a b"),
        ("e\u0301tude", "e\u0301tude"),
        ("हिन्दी", "हिन्दी"),
        ("ไม้เท้า", "ไม้เท้า"),
        ("\u0301a", "a"),
        ("a" + "\u0301" * 50 + "b", "a" + "\u0301" * 4 + "b"),
        ("w" * 500, "w" * (MAX_NAME_LENGTH - 1) + "…"),
    ):
        with case(name):
            assert clean_name(name) == clean
            assert clean_name(clean) == clean


def _title(service: Service, filename: str, **extra: object) -> str:
    answer = service.upload(filename, path_file(SNAKE, **extra))
    assert answer.status_code == 202, answer.text
    return str(service.state(answer.json()["id"])["title"])


def named_in_path(service: Service, name: str) -> str:
    return _title(service, "ok.json", name=name)


def named_by_file(service: Service, name: str) -> str:
    return _title(service, f"{name}.json")


def named_in_preview(service: Service, name: str) -> str:
    service.preview("ok.json", path_file(SNAKE, name=name), token="N" * 32, full="false")
    listed = service.http.get("/api/mine/previews", headers=bearer("N" * 32)).json()
    return str(listed["previews"][0]["title"])


def renamed(service: Service, name: str) -> str:
    fold = service.fold(SNAKE)
    path = f"/api/folds/{fold['id']}"
    answer = service.http.patch(path, json={"name": name}, headers=bearer(fold["owner_token"]))
    assert answer.is_success or answer.json()["code"] == "empty-name"
    return str(service.state(fold["id"])["title"])


@pytest.mark.parametrize("way", [named_in_path, named_by_file, named_in_preview, renamed])
def test_titles_are_visible_wherever_names_come_from(idle: Service, way: Any) -> None:
    blank = "\u3164\u2800\ufe0f\u200b\u0301\U000e0041\u00ad"
    blank_answer = way(idle, blank)
    assert blank_answer and blank_answer == clean_name(blank_answer)
    assert way(idle, f"wr{blank}ench").replace("\u0301", "") in ("wrench", "wrench.json")
