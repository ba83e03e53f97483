"""Names of downloaded files in all scripts."""

from __future__ import annotations

from pathlib import Path

import pytest
from fastapi.responses import FileResponse

from server.http.downloads import MAX_STEM_CHARACTERS, download_stem


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("wrench-160", "wrench-160"),
        ("Schlüssel", "Schlüssel"),
        ("Schlu\u0308ssel", "Schlüssel"),
        ("キリン 2", "キリン-2"),
        ("ключ", "ключ"),
        ('../a"b\r\nc', "a-b--c"),
        ("\u202egpj.exe", "gpj-exe"),
        ("…", "fold"),
        ("", "fold"),
    ],
)
def test_download_stem_keeps_letters_of_all_scripts_and_nothing_else(name: str, stem: str) -> None:
    assert download_stem(name) == stem


def test_download_stem_is_short_and_encoded_in_headers(tmp_path: Path) -> None:
    stem = download_stem("龍" * 500)
    assert len(stem) == MAX_STEM_CHARACTERS
    assert len(f"{stem}-trajectory.json".encode()) <= 255
    path = tmp_path / "page"
    path.write_bytes(b"")
    header = FileResponse(path, filename=f"{download_stem('ключ')}.html").headers
    assert header["content-disposition"] == (
        "attachment; filename*=utf-8''%D0%BA%D0%BB%D1%8E%D1%87.html"
    )
