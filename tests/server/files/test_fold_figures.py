import asyncio
import json
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock, patch

import pytest

from foldback import foldback_check_exhaustion
from foldback.planner.pipeline.fold_layout import lacks_derived_files, lacks_verdict
from foldback.planner.pipeline.manifest import read_manifest
from foldback.planner.storage.file_names import (
    CHAIN,
    DERIVED_FILES,
    EXHAUSTION,
    PLAN,
    PLAYBACK,
    REQUEST,
    START_CHAIN,
    TIMELINE,
    VERDICT,
    VERDICT_FILES,
)
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


def prisms(*angles_deg: int) -> str:
    """Return the file of a chain of prisms."""
    chain = {"format": "foldback-chain/1", "module": "snake-prism", "name": "hook"}
    return json.dumps({**chain, "joint_angles_deg": angles_deg})


def finished(service: Service, data: str, **form: str) -> FinishedFold:
    accepted = service.upload("hook.json", data, **form).json()
    return FinishedFold(service, accepted, [], service.wait_over(accepted["id"]))


def test_locked_figure_has_a_verdict_and_a_proof(service: Service, tmp_path: Path) -> None:
    fold = finished(service, prisms(0, 180, 180, 0))
    assert fold.state["status"] == "verified"
    assert not any((fold.directory / name).exists() for name in VERDICT_FILES)
    assert '"text": "", "has_proof": false, "hint": ""' in fold.http.get(fold.page).text
    first, proof = (fold.http.get(f"{fold.page}/{name}") for name in VERDICT_FILES)
    assert first.json()["has_proof"]
    assert "prisms, of at most 0.8062 of the full size" in first.json()["text"]
    assert "No sequence of single quarter turns leads there" in first.json()["text"]
    assert proof.headers["content-disposition"] == 'attachment; filename="hook-exhaustion.json"'
    (tmp_path / "proof.json").write_bytes(proof.content)
    assert foldback_check_exhaustion.check(str(tmp_path / "proof.json"))["verdict"] == "proved"
    program = fold.http.get("/static/foldback_check_exhaustion.py").content
    assert program == Path(foldback_check_exhaustion.__file__).read_bytes()
    assert first.json()["text"] in fold.http.get(f"{fold.page}?later").text
    assert set(VERDICT_FILES) <= set(read_manifest(fold.directory) or ())
    written = (fold.directory / VERDICT).stat().st_mtime_ns
    assert fold.http.get(f"{fold.page}/verdict.json").json() == first.json()
    assert (fold.directory / VERDICT).stat().st_mtime_ns == written

    path = fold.directory / VERDICT
    path.write_bytes(path.read_bytes().replace(b"smaller-modules", b"one-joint"))
    for name in VERDICT_FILES:  # what differs from the manifest is not shown
        assert fold.http.get(f"{fold.page}/{name}").status_code == 204


def test_free_figure_has_no_proof_and_cubes_have_no_verdict(
    service: Service, unseen: FinishedFold
) -> None:
    fold = finished(service, prisms(90, 0, 180))
    verdict = fold.http.get(f"{fold.page}/verdict.json").json()
    text = "One joint at a time leads there: 3 quarter turns."
    assert verdict == {"text": text, "has_proof": False, "hint": ""}
    assert fold.http.get(f"{fold.page}/exhaustion.json").status_code == 204
    assert not (fold.directory / EXHAUSTION).exists()
    assert 'id="full-size"' not in unseen.http.get(unseen.page).text
    for name in VERDICT_FILES:
        assert unseen.http.get(f"{unseen.page}/{name}").status_code == 204
        assert not (unseen.directory / name).exists()


def test_failed_fold_names_the_largest_size(service: Service) -> None:
    fold = finished(
        service, prisms(0, 180, 180, 0), module_size="0.9", strategy="turns", attempts="1"
    )
    assert fold.state["status"] == "failed"
    hint = fold.http.get(f"{fold.page}/verdict.json").json()["hint"]
    expected = "only for prisms of up to 0.8062 of the full size, but this fold asked for 0.9."
    assert expected in hint
    assert hint in fold.http.get(fold.page).text


@pytest.mark.parametrize(("modules", "judged"), [(100, True), (101, False), (2, False)])
def test_long_chains_have_no_verdict(modules: int, judged: bool, tmp_path: Path) -> None:
    chain = {"module": "snake-prism", "modules": modules}
    (tmp_path / CHAIN).write_text(json.dumps(chain))
    assert lacks_verdict(tmp_path) is judged
    (tmp_path / START_CHAIN).write_text("{}")  # a fold that begins with another figure
    assert not lacks_verdict(tmp_path)


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


def test_request_that_looked_before_a_computation_ended_shares_its_result(
    located: LocatedFold, tmp_path: Path
) -> None:
    calls: list[LocatedFold] = []
    second_looks, first_is_over = threading.Event(), threading.Event()

    def lacks(directory: Path) -> bool:
        if calls and not first_is_over.is_set():
            second_looks.set()
            assert first_is_over.wait(10)
        return True

    def compute(fold: LocatedFold) -> Path:
        calls.append(fold)
        assert second_looks.wait(10)
        return tmp_path / "elsewhere"

    async def ask() -> list[LocatedFold]:
        figures = FoldFigures(compute, lacks=lacks)
        first = asyncio.ensure_future(figures.of(located))
        while not calls:
            await asyncio.sleep(0)
        second = asyncio.ensure_future(figures.of(located))
        await first
        first_is_over.set()
        return [await first, await second]

    assert [fold.derived_dir for fold in asyncio.run(ask())] == [tmp_path / "elsewhere"] * 2
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
