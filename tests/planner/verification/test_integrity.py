"""Files of a finished fold are compared with its manifest, which may be damaged, too."""

import json
from pathlib import Path

import pytest

from foldback.planner.errors import DamagedError
from foldback.planner.pipeline.manifest import FILE, changed_fields, write_manifest
from foldback.planner.storage.file_names import PLAN_TEXT
from foldback.planner.verification.integrity import check, damaged_among
from tests.case import case


def test_damaged_manifest_is_reported(tmp_path: Path) -> None:
    (tmp_path / PLAN_TEXT).write_text("{}")
    write_manifest(tmp_path)
    assert (damaged_among(tmp_path, [PLAN_TEXT]), changed_fields(tmp_path)) == ([], [])
    manifest = json.loads((tmp_path / FILE).read_bytes())
    damaged: tuple[object, ...] = ([3], "x", {}, {**manifest, "sha256": {PLAN_TEXT: 3}})
    for values in (*damaged, {**manifest, "format": "foldback-manifest/0"}):
        with case(values):
            (tmp_path / FILE).write_text(json.dumps(values))
            with pytest.raises(DamagedError, match=FILE):
                check(tmp_path, PLAN_TEXT)
            assert changed_fields(tmp_path) == [f"{FILE}: content"]
