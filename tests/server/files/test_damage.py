"""Damaged files of a finished fold: each route reports them, and none shows invented data."""

import json
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import cycle
from pathlib import Path
from unittest.mock import patch

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from foldback.server.submission.shipped_folds import SHIPPED_FOLDS_DIR
from tests.server.routes import fold_addresses
from tests.server.service_process import SNAKE, FinishedFold, Service, check_problem
from tests.server.service_thread import ServiceThread

SMALL = SHIPPED_FOLDS_DIR / "tetra-cube-2.fold"
MOTION = "The stored motion of this fold is damaged"
MOTION_ROUTES = ("bundle", "batch", "figures", "standalone.html", "recording.viser")


@pytest.fixture(scope="module")
def whole_fold(service: Service) -> FinishedFold:
    """Separate fold, as damage to a shared one would affect other tests."""
    accepted = service.fold(SNAKE, seed=3)
    whole_fold = FinishedFold(service, accepted, [], service.wait_over(accepted["id"]))
    answer = whole_fold.http.get(f"{whole_fold.page}/tour.json")  # computes the figures
    assert answer.status_code == 200
    return whole_fold


@pytest.fixture
def fold(whole_fold: FinishedFold, tmp_path: Path) -> Iterator[FinishedFold]:
    """Fold whose files are restored afterwards."""
    shutil.copytree(whole_fold.directory, tmp_path / "whole")
    yield whole_fold
    shutil.rmtree(whole_fold.directory)
    shutil.copytree(tmp_path / "whole", whole_fold.directory)


def test_fold_with_lost_chunks_shows_no_motion(fold: FinishedFold) -> None:
    for chunk in (fold.directory / "timeline").glob("0*.npz"):
        chunk.unlink()
    for name in MOTION_ROUTES:
        answer = fold.http.get(f"{fold.page}/{name}")
        assert check_problem(answer, 500, "damaged-data").startswith(MOTION)
    check_problem(fold.http.get(f"{fold.api}/frames"), 500, "damaged-data")
    for path in (fold.page, f"/embed/{fold.id}", f"/compare?a={fold.id}&b={fold.id}"):
        assert MOTION in fold.http.get(path).text
    facts = fold.http.get(f"{fold.page}/facts").json()
    assert (facts["frames"], facts["verdict"]["text"], facts["downloads"]) == (0, MOTION, [])
    log = fold.service.log.read_text()
    assert "timeline/000000.npz" in log and fold.id in log


def test_damaged_download_is_refused(fold: FinishedFold) -> None:
    for name in ("plan.npz", "model.xml", "certificate.json", "record.npz"):
        data = bytearray((fold.directory / name).read_bytes())
        data[len(data) // 3] ^= 4
        (fold.directory / name).write_bytes(bytes(data))
        check_problem(fold.http.get(f"{fold.api}/{name}"), 500, "damaged-data")
    # The page contains the plan.
    check_problem(fold.http.get(f"{fold.page}/standalone.html"), 500, "damaged-data")


def test_private_picture_and_data_directory_are_closed_to_others(whole_fold: FinishedFold) -> None:
    """The database and the files of folds are closed as well, by their own modes."""
    answer = whole_fold.http.get(f"{whole_fold.page}/picture.png")
    assert (answer.status_code, answer.headers["Cache-Control"]) == (
        200,
        "private, no-cache, no-transform",
    )
    assert answer.content.startswith(b"\x89PNG")
    data_dir = whole_fold.service.data_dir
    assert data_dir.stat().st_mode & 0o077 == 0
    fold_files = [path for path in whole_fold.directory.rglob("*") if path.is_file()]
    assert fold_files
    written = [*data_dir.glob("*.db*"), *fold_files]
    assert not [path for path in written if path.stat().st_mode & 0o077]


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def empty(path: Path) -> None:
    path.write_bytes(b"")


def scribble(path: Path) -> None:
    path.write_bytes(bytes(range(256)) * 4)


def mistype(path: Path) -> None:
    path.write_text(json.dumps([{"verdict": 7, "chosen": None}, 3, "x"]))


def replace_by_directory(path: Path) -> None:
    path.unlink()
    path.mkdir()


DAMAGES: tuple[Callable[[Path], None], ...] = (
    empty,
    mistype,
    truncate,
    scribble,
    replace_by_directory,
    Path.unlink,
)


@pytest.mark.long
def test_fold_with_any_damaged_file_is_answered_in_sentences(fold: FinishedFold) -> None:
    """Every file is damaged in turn, and every route requested: undamaged parts are still shown."""
    directory, log = fold.directory, fold.service.log
    logged_before = log.stat().st_size
    files = [path for path in sorted(directory.iterdir()) if path.is_file()]
    files += [directory / "timeline" / "head.json", directory / "figures" / "head.json"]
    for path, damage in zip(files, cycle(DAMAGES), strict=False):
        file_bytes = path.read_bytes()
        damage(path)
        for address in fold_addresses(fold.id):
            answer = fold.http.get(address)
            assert answer.status_code < 500 or answer.json()["code"] == "damaged-data", (
                f"{path.name}: {address} {answer.status_code} {answer.text[:300]}"
            )
        if path.is_dir():
            path.rmdir()
        path.write_bytes(file_bytes)
    assert b"Traceback" not in log.read_bytes()[logged_before:]


@pytest.mark.parametrize("name", ["input", "request.json"])
def test_fold_made_again_of_damaged_input_is_refused(fold: FinishedFold, name: str) -> None:
    path = fold.directory / name
    data = path.read_bytes()
    for damage in (mistype, truncate, scribble):
        path.write_bytes(data)
        damage(path)
        for field in ("fold", "smooth"):
            status, problem = fold.service.refusal(**{field: fold.id})
            assert (status, problem["code"]) == (500, "damaged-data")
    path.with_name("manifest.json").unlink()  # failed folds have no manifest
    if name == "request.json":
        status, problem = fold.service.refusal(fold=fold.id)
        assert problem["code"] in ("no-input", "damaged-data"), status


@contextmanager
def service_with_shipped_fold(place: Path, **settings: object) -> Iterator[ServiceThread]:
    """Yield a service that came with one finished fold."""
    shutil.copy(SMALL, place)
    with (
        patch("foldback.server.submission.shipped_folds.SHIPPED_FOLDS_DIR", place),
        ServiceThread(place / "data", shipped_folds=True, **settings).start() as service,
    ):
        yield service


@pytest.fixture(scope="module")
def shipped(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceThread]:
    with service_with_shipped_fold(tmp_path_factory.mktemp("shipped")) as service:
        yield service


def test_route_that_makes_something_of_damaged_source_refuses(shipped: ServiceThread) -> None:
    """Exports that were stored before are refused, too."""
    fold_id = shipped.http.get("/api/folds").json()["folds"][0]["id"]
    place = shipped.directory(fold_id)
    (place / "exports").mkdir(exist_ok=True)
    (place / "exports" / "plan.csv").write_bytes(b"stored")
    page = f"/folds/{fold_id}"
    routes = [
        f"/api{page}/{part}" for part in ("trajectory", "motors?module_mass=1", "exports/csv")
    ]
    for source, method, paths in (
        ("plan.npz", "GET", routes),
        ("chain.json", "GET", [f"{page}/picture.png"]),
        ("timeline/000000.npz", "POST", [f"/api{page}/movies"]),
    ):
        file_bytes = (place / source).read_bytes()
        truncate(place / source)
        for path in paths:
            answer = shipped.http.request(method, path, json={} if method == "POST" else None)
            assert (answer.status_code, answer.json()["code"]) == (500, "damaged-data"), path
        if source == "plan.npz":
            address = f"{shipped.http.base_url}/api{page}/play".replace("http", "ws", 1)
            with pytest.raises(InvalidStatus) as refused:
                connect(address)
            assert "damaged-data" in str(refused.value.response.body)
        (place / source).write_bytes(file_bytes)


@pytest.mark.long
def test_no_route_of_private_fold_lets_shared_caches_store_it(shipped: ServiceThread) -> None:
    """All routes that name a fold and answer GET are checked, except the endless event stream."""
    fold_id = shipped.http.get("/api/folds").json()["folds"][0]["id"]
    with sqlite3.connect(shipped.data_dir / "foldback.db", timeout=60) as database:
        database.execute("UPDATE folds SET public = 0 WHERE id = ?", (fold_id,))
    database.close()
    addresses = fold_addresses(fold_id)
    assert len(addresses) > 20
    for path in addresses:
        allowed = shipped.http.get(path).headers.get("Cache-Control", "")
        assert "private" in allowed or "no-store" in allowed, f"{path}: {allowed!r}"
        assert "public" not in allowed and "s-maxage" not in allowed, path
