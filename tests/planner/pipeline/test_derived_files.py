import json
import shutil
from pathlib import Path as FilePath

import pytest

from foldback.planner.certificate.figures_store import Figures
from foldback.planner.errors import DamagedError
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline import derived_files
from foldback.planner.pipeline.derived_files import complete, completed
from foldback.planner.pipeline.fold_layout import (
    lacks_derived_files,
    lacks_verdict,
    stored_moments,
    stored_verdict,
)
from foldback.planner.pipeline.manifest import FILE, changed_fields, read_manifest, write_manifest
from foldback.planner.storage.file_names import CHAIN, DERIVED_FILES, FIGURES, MOMENTS, VERDICT
from foldback.planner.verification.integrity import check, damaged_among
from foldback.planner.verification.repeated import verdict_differs
from foldback.planner.verification.stored_fold import read_fold
from foldback.planner.verification.verify import verify
from tests.planner.folds import run_fold

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Directory of a fold without figures and moments; tests must not change it."""
    directory = tmp_path_factory.mktemp("finished")
    run_fold(directory, strategy="simultaneous", settings="robots=1")
    return directory


@pytest.fixture
def directory(finished: FilePath, tmp_path: FilePath) -> FilePath:
    return shutil.copytree(finished, tmp_path / "fold")


def test_derived_files_are_made_once_and_listed_in_the_manifest(directory: FilePath) -> None:
    before = read_manifest(directory)
    assert before is not None and lacks_derived_files(directory)
    assert not any((directory / name).exists() for name in DERIVED_FILES)
    complete(directory)
    after = read_manifest(directory)
    assert after is not None and {name: after[name] for name in before} == before
    assert after.keys() - before.keys() == set(DERIVED_FILES)
    assert changed_fields(directory) == [] and verify(directory).problems == ()
    frames = len(Timeline.open(directory / "timeline"))
    assert len(Figures.load(directory / FIGURES)) == frames
    moments = stored_moments(directory)
    assert moments is not None and moments.frames == frames and moments.torque is not None
    written = [(directory / name).stat().st_mtime_ns for name in (FIGURES, MOMENTS, FILE)]
    complete(directory)
    assert [(directory / name).stat().st_mtime_ns for name in (FIGURES, MOMENTS, FILE)] == written


@pytest.mark.parametrize("name", DERIVED_FILES)
def test_missing_file_is_computed_again(name: str, directory: FilePath) -> None:
    complete(directory)
    manifest = read_manifest(directory)
    path = directory / name
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert lacks_derived_files(directory)
    check(directory, name)
    read_fold(directory)
    complete(directory)
    assert read_manifest(directory) == manifest and changed_fields(directory) == []


def test_file_that_the_manifest_does_not_list_is_not_believed(directory: FilePath) -> None:
    complete(directory)
    expected = (directory / MOMENTS).read_bytes()
    values = json.loads((directory / FILE).read_bytes())
    del values["sha256"][MOMENTS]
    (directory / FILE).write_text(json.dumps(values))
    (directory / MOMENTS).write_bytes(expected.replace(b'"straight": ', b'"straight": 1'))
    read_fold(directory)  # it is not a part of the fold
    assert any(MOMENTS in problem for problem in verify(directory).problems)
    complete(directory)
    assert (directory / MOMENTS).read_bytes() == expected


def test_damaged_file_is_refused(directory: FilePath) -> None:
    complete(directory)
    text = (directory / MOMENTS).read_bytes()
    (directory / MOMENTS).write_bytes(text.replace(b'"straight": ', b'"straight": 1'))
    assert not lacks_derived_files(directory)
    assert damaged_among(directory, DERIVED_FILES) == [MOMENTS]
    (directory / FILE).write_text("{")
    with pytest.raises(DamagedError, match=FILE):
        complete(directory)


def test_folder_that_cannot_be_written_stays_as_it_is(
    directory: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = sorted(path.name for path in directory.iterdir())
    monkeypatch.setattr(derived_files, "refuses_writing", lambda _: True)  # root may always write
    with completed(directory) as derived_dir:
        assert derived_dir != directory
        assert stored_moments(derived_dir) is not None
        assert len(Figures.load(derived_dir / FIGURES))
    assert not derived_dir.exists()
    assert sorted(path.name for path in directory.iterdir()) == before


def test_verdict_is_made_once_and_a_forged_one_is_found(
    tmp_path: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    chain = {"format": "foldback-chain/1", "module": "snake-prism"}
    data = json.dumps({**chain, "joint_angles_deg": [0, 180, 180, 0]}).encode()
    directory = tmp_path / "fold"
    run_fold(directory, data)
    with monkeypatch.context() as patched:
        patched.setattr(derived_files, "refuses_writing", lambda _: True)
        with completed(directory, "verdict") as derived_dir:
            assert derived_dir != directory and stored_verdict(derived_dir) is not None
    assert lacks_verdict(directory)
    complete(directory, "verdict")
    verdict = stored_verdict(directory)
    assert verdict is not None and verdict.smaller is not None
    assert (verdict.kind, round(verdict.smaller.size, 3)) == ("smaller-modules", 0.806)
    assert not lacks_verdict(directory) and changed_fields(directory) == []
    verification = verify(directory)
    assert verification.problems == ()
    assert any("exhaustion.json were computed again" in line for line in verification.checked)

    path = directory / VERDICT
    path.write_bytes(path.read_bytes().replace(b"smaller-modules", b"one-joint"))
    write_manifest(directory)
    assert any("verdict.json.kind" in problem for problem in verify(directory).problems)
    chain_path = directory / CHAIN  # cubes get no verdict
    chain_path.write_bytes(chain_path.read_bytes().replace(b'"snake-prism"', b'"cube"'))
    assert [*verdict_differs(directory)] == [
        "verdict.json and exhaustion.json: the figure of this fold is not one that gets a verdict"
    ]
