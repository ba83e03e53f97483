import asyncio
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, patch

import pytest

from foldback.planner.pipeline.fold_layout import lacks_derived_files
from foldback.planner.pipeline.manifest import read_manifest
from foldback.planner.storage.file_names import DERIVED_FILES, PLAN, PLAYBACK, REQUEST, TIMELINE
from foldback.server.files.fold_figures import FoldFigures, figures_by
from foldback.server.processes.children import CRASHED, ChildError
from foldback.server.settings import Settings
from foldback.server.store.fold_source import LocatedFold
from foldback.server.store.folds import Store
from foldback.words.fold import ShownFold
from tests.server.service_process import SNAKE, FinishedFold, Service
from tests.web.timeline.decoding import decode


@pytest.fixture(scope="module")
def unseen(service: Service) -> FinishedFold:
    """Finished fold at which nobody has looked."""
    accepted = service.fold(SNAKE, seed=5, strategy="simultaneous")
    return FinishedFold(service, accepted, [], service.wait_over(accepted["id"]))


def test_first_request_computes_figures_and_moments_once(unseen: FinishedFold) -> None:
    directory = unseen.directory
    assert unseen.state["status"] == "verified"
    assert not any((directory / name).exists() for name in DERIVED_FILES)
    assert TIMELINE in (read_manifest(directory) or ())
    paths = [f"{unseen.page}/{name}" for name in ("figures", "tour.json", "figures", "steps.json")]
    with ThreadPoolExecutor(len(paths)) as pool:
        figures, tour, again, steps = pool.map(unseen.http.get, paths)
    assert [r.status_code for r in (figures, tour, again, steps)] == [200, 200, 200, 204]
    assert decode(figures.content)[0]["frames"] == tour.json()["stops"][-1]["frame"]
    assert any("torque" in stop["caption"] for stop in tour.json()["stops"])
    assert not lacks_derived_files(directory)
    written = [(directory / name).stat().st_mtime_ns for name in DERIVED_FILES]
    assert unseen.http.get(f"{unseen.api}/tour").json() == tour.json()
    assert unseen.http.get(f"{unseen.page}/standalone.html").status_code == 200
    assert [(directory / name).stat().st_mtime_ns for name in DERIVED_FILES] == written


def test_nothing_is_computed_from_damaged_files(service: Service) -> None:
    accepted = service.fold(SNAKE, seed=6, strategy="simultaneous")
    fold = FinishedFold(service, accepted, [], service.wait_over(accepted["id"]))
    path = fold.directory / "certificate.json"
    path.write_bytes(path.read_bytes().replace(b'"module_size": 0.9', b'"module_size": 0.8'))
    assert fold.http.get(f"{fold.page}/figures").status_code == 204
    assert not any((fold.directory / name).exists() for name in DERIVED_FILES)
    assert "figures failed" in fold.service.log.read_text()


@pytest.fixture
def located(tmp_path: Path) -> LocatedFold:
    """Finished fold without figures; only the names of its files are there."""
    for name in (REQUEST, TIMELINE, PLAN, PLAYBACK):
        (tmp_path / name).write_text("{}")
    row = MagicMock(spec=ShownFold, id="fold", status="verified")
    return LocatedFold(row, tmp_path)


def test_requests_at_once_share_one_computation(located: LocatedFold, tmp_path: Path) -> None:
    calls: list[LocatedFold] = []
    entered = threading.Event()

    def compute(fold: LocatedFold) -> Path:
        calls.append(fold)
        assert entered.wait(10)
        return tmp_path / "elsewhere"

    async def ask() -> list[LocatedFold]:
        figures = FoldFigures(compute)
        asking = [asyncio.ensure_future(figures.of(located)) for _ in range(3)]
        while not calls:
            await asyncio.sleep(0)
        entered.set()
        folds = [await future for future in asking]
        return [*folds, await figures.of(located)]

    assert [fold.derived_dir for fold in asyncio.run(ask())] == [tmp_path / "elsewhere"] * 4
    assert len(calls) == 1


def test_running_folds_and_other_plans_are_left_alone(located: LocatedFold) -> None:
    compute = MagicMock()
    running = replace(located, row=MagicMock(spec=ShownFold, status="running"))
    other = replace(located, alternative_to="fold")

    async def ask() -> None:
        figures = FoldFigures(compute)
        assert [await figures.of(fold) for fold in (running, other)] == [running, other]

    asyncio.run(ask())
    compute.assert_not_called()


def test_failed_computation_is_not_repeated(
    located: LocatedFold, caplog: pytest.LogCaptureFixture
) -> None:
    compute = MagicMock(side_effect=ChildError(CRASHED, "it was ended by SIGKILL."))

    async def ask() -> None:
        figures = FoldFigures(compute)
        assert (await figures.of(located)).derived_dir == located.directory
        await figures.of(located)

    asyncio.run(ask())
    compute.assert_called_once()
    assert "SIGKILL" in caplog.text


@pytest.mark.parametrize("read_only", [False, True])
def test_files_of_a_deleted_fold_do_not_come_back(
    read_only: bool, located: LocatedFold, store: Store, tmp_path: Path
) -> None:
    children: Any = MagicMock()
    with (
        patch("foldback.server.settings.refuses_writing", return_value=read_only),
        patch("foldback.server.files.fold_figures.check"),
    ):
        settings = Settings(data_dir=tmp_path / "data")
        asyncio.run(figures_by(children, settings, store).of(located))
    assert [children.take.called, children.release.called] == [not read_only] * 2
    assert located.directory.exists() is read_only  # the store has no such fold
