"""Restores that end at any moment leave all old rows and files, or all new ones."""

import random
import signal
import sys
import time
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import pytest

from foldback.server.store.folds import Store
from tests.server.backups import REFUSED_CODE, Fault, Site, State
from tests.server.postgres import Postgres

KINDS = ["sqlite, directory", "postgresql, directory", "sqlite, bucket", "postgresql, bucket"]


class Restorable(NamedTuple):
    """A service, a backup of another state of it, and a backup of its own state."""

    site: Site
    other: Path
    own: Path
    old: State
    new: State

    def end_at(self, moment: float, fault: Fault) -> str:
        """Restore the other state until a moment; return what is there afterwards."""
        code = self.site.restore_until(self.other, moment, fault).code
        assert code in (0, REFUSED_CODE, -signal.SIGKILL), code
        state = self.site.state()
        assert state in (self.old, self.new), f"{fault} at {moment}"
        assert state == self.new or code != 0
        if state == self.old:
            return "old"
        self.undo()
        return "new"

    def undo(self) -> None:
        """Restore the own state."""
        done = self.site.run("restore", "--replace", self.own)
        assert done.exit_code == 0, done.output
        assert self.site.state() == self.old
        assert not self.site.staged()

    def moments(self) -> int:
        """Return the number of moments of a whole restore."""
        code, moments = self.site.restore_until(self.other, sys.maxsize)
        assert code == 0 and self.site.state() == self.new
        self.undo()
        return moments


@pytest.fixture
def restorable(kind: str, tmp_path: Path, request: pytest.FixtureRequest) -> Restorable:
    database, storage = kind.split(", ")
    postgres: Postgres = request.getfixturevalue("postgres") if database == "postgresql" else None
    bucket_url = request.getfixturevalue("bucket_url") if storage == "bucket" else None
    site = Site(tmp_path / "data", postgres.migrated() if postgres else None, bucket_url)
    for fold_id in ("same", "changed", "gone"):
        site.add(fold_id)
    second, own_directory = tmp_path / "other", tmp_path / "own"
    assert site.run("backup", second).exit_code == 0
    new = site.state()
    with closing(Store(site.settings)) as store:
        store.delete("changed")
        store.folders.remove("changed")
    site.add("changed", content=b"other cells")
    site.add("later")
    assert site.run("expire", "--yes", "--force", "gone").exit_code == 0
    assert site.run("backup", own_directory).exit_code == 0
    old = site.state()
    assert old[0] != new[0] and old[1] != new[1]
    return Restorable(site, second, own_directory, old, new)


def check(restorable: Restorable, moments: list[tuple[float, Fault]]) -> Counter[str]:
    """Check that all moments lead to one of the two states, and both to some; count them."""
    outcomes = Counter(f"{fault}: {restorable.end_at(at, fault)}" for at, fault in moments)
    assert any("old" in outcome for outcome in outcomes)
    assert any("new" in outcome for outcome in outcomes)
    return outcomes


@pytest.mark.processes
@pytest.mark.parametrize("kind", [KINDS[0], pytest.param(KINDS[-1], marks=pytest.mark.long)])
def test_ended_restore_leaves_the_old_state_or_the_new_one(restorable: Restorable) -> None:
    last = restorable.moments()
    check(restorable, [(last // 2, "killed"), (last - 35, "full"), (last - 8, "killed")])


@pytest.mark.long
@pytest.mark.parametrize("kind", KINDS)
def test_restore_ended_at_many_moments_leaves_one_of_the_states(
    kind: str, restorable: Restorable
) -> None:
    chosen_random = random.Random(kind)
    last = restorable.moments()
    # Most statements are those of the migrations; the second half are the moments after them.
    moments: list[tuple[float, Fault]] = []
    for fault in ("killed", "full"):
        moments += [(chosen_random.randint(1, last), fault) for _ in range(20)]
        moments += [(chosen_random.randint(last - 60, last), fault) for _ in range(20)]
    started = time.monotonic()
    restorable.moments()
    duration_s = time.monotonic() - started
    moments += [(chosen_random.uniform(0, duration_s), "killed") for _ in range(40)]
    print(f"{kind}: {last} moments, {duration_s:.1f} s, {dict(check(restorable, moments))}")
