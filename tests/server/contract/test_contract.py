"""Texts that others rely on: the description of the API, help texts, and pages."""

from __future__ import annotations

from pathlib import Path

from tests.server.contract.texts import STORE, stored, texts


def test_texts_for_programs_and_people_are_the_stored_ones(tmp_path: Path) -> None:
    known, current = stored(), texts(tmp_path / "data")
    assert current.keys() == known.keys(), STORE
    for name, text in current.items():
        assert text == known[name], f"{name} differs; {STORE}"
