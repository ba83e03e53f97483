"""Finished folds that ship with the package."""

from contextlib import closing
from functools import partial
from pathlib import Path

import pytest
import sqlalchemy as sa

from foldback.planner.pipeline import manifest, request
from foldback.planner.pipeline.packed_fold import unpack
from foldback.planner.plan.plan import Plan
from foldback.planner.readers.gallery import Gallery
from foldback.planner.verification.plan_parameters import request_differs
from foldback.planner.verification.verify import verify
from foldback.server.pages.cards import shipped_folds
from foldback.server.settings import Settings
from foldback.server.store.folds import Store
from foldback.server.store.schema import CounterRow
from foldback.server.submission.shipped_folds import SHIPPED_FOLDS_DIR, import_shipped_folds
from tests.planner.later_parameters import later

NAMES = sorted(path.stem for path in SHIPPED_FOLDS_DIR.glob("*.fold"))
SMALL, REFOLD = "tetra-cube-2", "wrench-80-to-mallet-80"


def test_shipped_folds_are_imported_once_and_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Imports only two of the five folds, as verifying all takes long."""
    assert len(NAMES) == 5
    assert sum(path.stat().st_size for path in SHIPPED_FOLDS_DIR.glob("*.fold")) < 1_600_000
    folder = tmp_path / "finished"
    folder.mkdir()
    for name in (SMALL, REFOLD):
        (folder / f"{name}.fold").symlink_to(SHIPPED_FOLDS_DIR / f"{name}.fold")
    (folder / "broken.fold").write_bytes(b"no archive")
    monkeypatch.setattr("foldback.server.submission.shipped_folds.SHIPPED_FOLDS_DIR", folder)
    settings = Settings(data_dir=tmp_path / "data")
    with closing(Store(settings)) as store:
        assert import_shipped_folds(settings, store, Gallery()) == [SMALL, REFOLD]
        assert "the finished fold broken could not be imported" in caplog.text
        rows = {row.module: row for row in store.list_public()}
        assert [rows[module].refold for module in ("cube", "tetrahedron")] == ["wrench-80", None]
        for row in rows.values():
            values = (row.status, row.visitor, row.bytes, row.pinned)
            assert values == ("verified", "the service itself", 0, True)
            assert manifest.changed_fields(store.directory(row.id)) == [], row.name
        # A deleted fold is not imported again, nor is one that has been folded here.
        assert store.delete(rows["cube"].id)
        with store.changing() as session:
            session.execute(sa.delete(CounterRow).where(CounterRow.name == f"finished {SMALL}"))
        assert import_shipped_folds(settings, store, Gallery()) == []
        assert len(shipped_folds(store)) == 1
        names = {path.name for path in settings.folds_dir.iterdir()}
        assert names == {row.id for row in rows.values()}  # the sweep has removed the deleted fold


def test_parameter_of_a_later_version_makes_no_difference(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in NAMES:
        (tmp_path / name).mkdir()
        unpack((SHIPPED_FOLDS_DIR / f"{name}.fold").read_bytes(), tmp_path / name)
    monkeypatch.setattr(request, "preset", later)
    plans = {name: Plan.load(tmp_path / name / "plan.npz") for name in NAMES}
    for name, plan in plans.items():
        assert list(request_differs(tmp_path / name, plan, [])) == [], name
    # A value that the plan does not have changes what is computed.
    monkeypatch.setattr(request, "preset", partial(later, made_up_rad=0.01))
    for name, plan in plans.items():
        (problem,) = request_differs(tmp_path / name, plan, [])
        assert problem.endswith("robot.made_up_rad: got 0.0, expected 0.01"), name


@pytest.mark.parametrize(
    "name",
    [name if name == SMALL else pytest.param(name, marks=pytest.mark.long) for name in NAMES],
)
def test_finished_fold_verifies_again(name: str, tmp_path: Path) -> None:
    unpack((SHIPPED_FOLDS_DIR / f"{name}.fold").read_bytes(), tmp_path)
    verification = verify(tmp_path)
    assert (verification.problems, verification.robots_repeated) == ((), True)
