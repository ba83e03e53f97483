"""Folders with files of two folds: every command that reads one refuses it, in one sentence."""

import json
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from foldback.planner.errors import InputError
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.plan.plan import Plan
from foldback.planner.reasons import Reason, ReasonCode
from foldback.planner.storage.files import json_of
from foldback.planner.verification.stored_fold import check_fold
from foldback.viewer import show
from tests.case import case
from tests.planner.folds import run_fold
from tests.refusal import refused
from tests.run_python import ROOT
from tests.server.cli.test_command_line import foldback, foldback_json
from tests.server.service_process import wait_until

READERS = (
    "export {} --as stl --out out",
    "retime {} --max-speed 1 --max-acceleration 1 --out out.csv",
    "smooth {} --out out",
    "refold {} {} --out out",
    "table {}",
    "tour {}",
    "servos --torque 1 --pitch-mm 40 --plan {}",
    "movie {} --out out.gif",
    "play {} --no-browser",
    "site out --no-finished --folds {}",
)
"""Commands that read the folder of a fold."""
PARTS = (
    *("plan.npz", "chain.json", "request.json", "input", "model.xml"),
    *("timeline", "certificate.json", "attempts.json", "candidates.json", "record.npz"),
    *("playback.npz", "moments.json"),
)
"""Files that are of another fold, one at a time."""


@pytest.fixture(scope="module")
def folds(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Two folds of the same coil that differ in the seed."""
    place = tmp_path_factory.mktemp("folds")
    for seed in (1, 2):
        run_fold(place / str(seed), seed=seed, settings="robots=1", strategy="simultaneous")
        complete(place / str(seed))
    return place / "1", place / "2"


@pytest.fixture
def fold(folds: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Copy of one of them, named ``fold``, in the current folder."""
    monkeypatch.chdir(tmp_path)
    return Path(shutil.copytree(folds[0], "fold"))


def put(source: Path, target: Path) -> None:
    """Replace a file or folder."""
    if source.is_dir():
        shutil.rmtree(target)
        shutil.copytree(source, target)
    else:
        shutil.copy(source, target)


SAME = ("input", "chain.json", "candidates.json", "model.xml", "moments.json")
"""Files that are the same in both folds, or that only a manifest tells apart."""


@pytest.mark.parametrize("name", PARTS)
def test_each_part_of_another_fold_is_found(
    folds: tuple[Path, Path], fold: Path, name: str
) -> None:
    put(folds[1] / name, fold / name)
    if name in SAME:
        values = (fold / name).read_bytes()
        (fold / name).write_bytes(values.replace(b"coil", b"soil").replace(b"1", b"2"))
    else:
        (fold / "manifest.json").unlink()
    with refused("mixed-fold", match="not of one fold"):
        check_fold(fold)
    put(folds[0] / name, fold / name)
    assert check_fold(fold) is not None


def test_texts_of_files_do_not_steer_the_terminal(fold: Path) -> None:
    hostile = "\x1b[2Jverified"
    reason = Reason.of(ReasonCode.PLAN_START, start=hostile)
    plan = Plan.load(fold / "plan.npz")
    certificate = replace(plan.certificate, reason=reason)
    replace(plan, certificate=certificate).save_npz(fold / "plan.npz")
    for name in ("certificate.json", "manifest.json"):
        (fold / name).unlink()
    for command in READERS:
        with case(command):
            done = foldback(*shlex.split(command.replace("{}", "fold")))
            assert done.returncode == 2 and "control characters" in done.stderr
            assert "\x1b" not in done.stdout + done.stderr


def test_every_command_refuses_a_mixed_folder(folds: tuple[Path, Path], fold: Path) -> None:
    put(folds[1] / "plan.npz", fold / "plan.npz")
    before = sorted(Path().rglob("*"))
    for command in READERS:
        with case(command):
            done = foldback(*shlex.split(command.replace("{}", "fold")))
            assert done.returncode == 2
            assert "not of one fold" in done.stderr and "fold the shape again" in done.stderr
            assert sorted(Path().rglob("*")) == before
    with pytest.raises(InputError, match="not of one fold"):
        show(fold, port=0)
    assert foldback("verify", fold).returncode == 3


BROKEN: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda data: b"",
    "half": lambda data: data[: len(data) // 2],
}
BROKEN_JSON = BROKEN | {
    "no JSON": lambda data: b"{\x1b[2Jtrue",
    "another value": lambda data: b"[1]",
    "deep": lambda data: b"[" * 100_000,
}


def test_broken_files_are_refused_in_one_sentence(folds: tuple[Path, Path], fold: Path) -> None:
    files = ("certificate.json", "chain.json", "attempts.json", "plan.npz")
    for name in (*files, "request.json", "candidates.json", "playback.npz", "record.npz"):
        for kind, change in (BROKEN_JSON if name.endswith(".json") else BROKEN).items():
            with case(f"{name}, {kind}"):
                (fold / name).write_bytes(change((folds[0] / name).read_bytes()))
                # `verify` has a reader of its own, and takes longer.
                for command in ("tour", *(["verify"] if kind == "half" else [])):
                    done = foldback(command, fold)
                    assert done.returncode in ((2,) if command == "tour" else (2, 3))
                    assert name.partition(".")[0] in done.stdout + done.stderr
                    assert "Traceback" not in done.stderr
                    assert "\x1b" not in done.stdout + done.stderr
        put(folds[0] / name, fold / name)
    assert foldback("tour", fold).returncode == 0


def test_new_fold_replaces_the_old_one_as_a_whole(fold: Path) -> None:
    (fold / "notes.txt").write_text("mine")
    assert foldback("table", fold).returncode in (0, 3)
    assert (fold / "table.json").exists()
    foldback_json("export", fold, "--as", "urdf", "--out", fold)
    before = sorted(fold.iterdir())
    assert foldback("fold", "wrench-2", "--out", fold).returncode == 2
    Path("bad.json").write_text("[[0, 0, 0], [5, 5, 5]]")
    assert foldback("fold", "bad.json", "--out", fold).returncode == 2
    assert sorted(fold.iterdir()) == before
    Path("row.json").write_text(json.dumps([[x, 0, 0] for x in range(5)]))
    foldback_json("fold", "row.json", "--out", fold)
    plan = check_fold(fold)
    assert plan is not None and len(plan.chain) == 5
    names = {path.name for path in fold.iterdir()}
    assert "notes.txt" in names and not names & {"table.json", "model.urdf"}
    (fold / "tour.json").write_text("{}")
    answer = foldback("fold", "row.json", "--out", fold)
    assert answer.returncode == 2 and "tour.json" in answer.stderr


def test_fold_of_an_earlier_version_is_refused_and_replaced(fold: Path) -> None:
    (fold / "timeline").rename(fold / "timeline.zarr")
    for command in ("tour", "verify"):
        answer = foldback(command, fold)
        assert answer.returncode == 2 and "earlier version of foldback" in answer.stderr
        assert "Fold the shape again." in answer.stderr
    Path("row.json").write_text(json.dumps([[x, 0, 0] for x in range(5)]))
    foldback_json("fold", "row.json", "--out", fold)
    assert not (fold / "timeline.zarr").exists() and (fold / "timeline").exists()


def test_export_of_another_fold_replaces_all_files(folds: tuple[Path, Path], fold: Path) -> None:
    foldback_json("export", fold, "--as", "urdf,csv", "--out", "files")
    foldback_json("export", fold, "--as", "stl", "--out", "files")
    names = {path.name for path in Path("files").iterdir() if path.name[0] != "."}
    assert names == {"model.urdf", "plan.csv", "module.stl"}
    foldback_json("export", folds[1], "--as", "csv", "--out", "files")
    assert [path.name for path in Path("files").iterdir() if path.name[0] != "."] == ["plan.csv"]
    answer = foldback("export", folds[1], "--as", "csv", "--out", fold)
    assert answer.returncode == 2 and "another fold" in answer.stderr


def test_site_is_not_written_into_the_folder_of_a_fold(fold: Path) -> None:
    before = sorted(fold.iterdir())
    answer = foldback("site", fold, "--no-finished", "--folds", fold)
    assert answer.returncode == 2
    assert "folder of a fold" in answer.stderr
    assert sorted(fold.iterdir()) == before


@pytest.mark.processes
@pytest.mark.parametrize(
    "number", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_old_fold_is_whole_after_a_run_was_ended(fold: Path, number: signal.Signals) -> None:
    command = [sys.executable, "-m", "foldback.server.cli.command_line", "fold", "wrench-80"]
    growing = fold / ".foldback-new"
    with subprocess.Popen(
        [*command, "--out", str(fold.resolve())],
        cwd=ROOT,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    ) as running:
        wait_until(
            lambda: (
                running.poll() is not None or json_of(growing / "chain.json").get("modules") == 80
            )
        )
        assert running.poll() is None
        running.send_signal(number)
        assert running.wait(60) != 0
    assert check_fold(fold) is not None
    assert foldback("verify", fold).returncode == 0
    Path("row.json").write_text(json.dumps([[x, 0, 0] for x in range(5)]))
    foldback_json("fold", "row.json", "--out", fold)
    assert not growing.exists()
