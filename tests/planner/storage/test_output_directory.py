"""Output directories: files of two runs are never together, whenever a run is ended."""

import json
import os
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

import pytest

from foldback.planner.errors import InputError
from foldback.planner.pipeline.fold_layout import replacing_fold
from foldback.planner.storage import output_directory
from foldback.planner.storage.output_directory import (
    finish_replacement,
    replacing,
    replacing_listed,
)
from tests.refusal import refused

CHANGES = ("rename", "replace", "unlink", "rmdir", "mkdir", "open")
"""Functions of ``os`` that change a disk."""


class KilledError(BaseException):
    """End of a process that is killed: nothing that follows changes the disk."""


@pytest.fixture
def kill_at(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int], None]]:
    """Return a function that sets after how many changes of the disk the process is killed."""
    remaining_bytes = [10**9]

    def counted(original: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any, **extra: Any) -> Any:
            remaining_bytes[0] -= 1
            if remaining_bytes[0] < 0:
                raise KilledError
            return original(*arguments, **extra)

        return call

    for name in CHANGES:
        monkeypatch.setattr(os, name, counted(getattr(os, name)))
    yield lambda count: remaining_bytes.__setitem__(0, count)
    remaining_bytes[0] = 10**9


def write(place: Path, run: str, names: tuple[str, ...]) -> None:
    for name in names:
        path = place / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(run)


def contents(place: Path) -> dict[str, str]:
    """Return the visible files of a directory."""
    return {
        path.relative_to(place).as_posix(): path.read_text()
        for path in place.rglob("*")
        if path.is_file() and not path.relative_to(place).as_posix().startswith(".")
    }


OLD = ("plan.npz", "timeline/a/c", "timeline/b", "attempts.json", "start/plan.npz")
NEW = ("plan.npz", "timeline/a/c", "timeline/d/e", "model.xml")
EARLIER = ("plan.npz", "timeline", "attempts.json", "start/plan.npz", "model.xml")


def test_a_run_that_is_killed_leaves_the_old_files_or_the_new_ones(
    tmp_path: Path, kill_at: Callable[[int], None]
) -> None:
    old = {**dict.fromkeys(OLD, "old"), "notes.txt": "mine", "start/notes.txt": "mine"}
    new = {**dict.fromkeys(NEW, "new"), "notes.txt": "mine", "start/notes.txt": "mine"}
    ended_flags: list[bool] = []
    for count in range(200):
        place = tmp_path / str(count)
        write(place, "old", OLD)
        write(place, "mine", ("notes.txt", "start/notes.txt"))
        kill_at(count)
        try:
            with replacing(place, lambda _: EARLIER) as growing:
                write(growing, "new", NEW)
            ended = True
        except KilledError:
            ended = False
        # The next command may be killed as well, and so on.
        for trial in range(0 if ended else 3):
            kill_at(3 * trial)
            try:
                finish_replacement(place)
            except KilledError:
                continue
        kill_at(10**9)
        finish_replacement(place)
        assert contents(place) in (old, new), count
        ended_flags.append(contents(place) == new)
        with replacing(place, lambda _: EARLIER) as growing:
            write(growing, "third", ("plan.npz",))
        assert contents(place) == {
            "plan.npz": "third",
            "notes.txt": "mine",
            "start/notes.txt": "mine",
        }
        assert {path.name for path in place.iterdir()} == {"plan.npz", "notes.txt", "start"}
        if ended:
            break
    assert ended and ended_flags == sorted(ended_flags) and len(ended_flags) > 20


def test_a_run_that_fails_leaves_everything_as_it_was(tmp_path: Path) -> None:
    place, fresh = tmp_path / "old", tmp_path / "fresh"
    write(place, "old", OLD)
    for directory, error in product((place, fresh), (OSError, KeyboardInterrupt)):
        with pytest.raises(error), replacing(directory, lambda _: EARLIER) as paths:
            write(paths, "new", NEW[:2])
            raise error
    assert contents(place) == dict.fromkeys(OLD, "old")
    assert sorted(tmp_path.iterdir()) == [place]


def test_other_files_are_not_replaced(tmp_path: Path) -> None:
    place = tmp_path / "mine"
    write(place, "mine", ("model.xml", "folds/notes"))
    for name in ("model.xml", "folds"):
        with refused("foreign-file", match=name), replacing_listed(place, None) as growing:
            write(growing, "new", (name,))
    with refused("foreign-file", match="model.xml"), replacing_fold(place):
        pytest.fail("this begins although its files would replace others")
    assert contents(place) == {"model.xml": "mine", "folds/notes": "mine"}


def test_files_of_the_same_source_stay_and_those_of_another_go(tmp_path: Path) -> None:
    for source, name, expected in (
        ("a", "x", {"x"}),
        ("a", "y/z", {"x", "y/z"}),
        ("a", "x", {"x", "y/z"}),
        ("b", "w", {"w"}),
        (None, "x", {"x"}),
        (None, "v", {"v"}),
    ):
        with replacing_listed(tmp_path, source) as growing:
            write(growing, "run", (name,))
        assert contents(tmp_path).keys() == expected
        assert not (tmp_path / "y").exists() or "y/z" in expected


def test_two_runs_do_not_write_into_one_directory(tmp_path: Path) -> None:
    with replacing(tmp_path, lambda _: ()) as growing:
        with refused("in-use"), replacing(tmp_path, lambda _: ()):
            pytest.fail("two runs write at once")
        write(growing, "new", ("plan.npz",))
    assert contents(tmp_path) == {"plan.npz": "new"}


@pytest.mark.parametrize("name", ["../victim", "link/victim", "/victim", "..", ""])
def test_a_list_of_files_does_not_lead_out_of_the_directory(tmp_path: Path, name: str) -> None:
    """The directory may come from somebody else."""
    victim, place = tmp_path / "victim", tmp_path / "place"
    victim.write_text("mine")
    complete = place / output_directory._COMPLETE
    complete.mkdir(parents=True)
    (place / "link").symlink_to(tmp_path)
    (complete / ".replaced.json").write_text(
        json.dumps([name.replace("/v", f"{tmp_path}/v", 1) if name.startswith("/") else name])
    )
    with refused("unfinished"):
        finish_replacement(place)
    assert victim.read_text() == "mine"


def test_directory_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="cannot be created"), replacing_fold(tmp_path / "file/x"):
        pytest.fail("there is no directory")
