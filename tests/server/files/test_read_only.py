"""Data on a read-only disk: stored folds are shown; all else is refused with one sentence."""

import os
import shutil
import sqlite3
import subprocess
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from unittest.mock import patch

import pytest

from foldback.server.doctor.data import database, directory
from foldback.server.settings import Settings
from foldback.server.store.schema import read_only_engine
from tests.server.files.test_damage import service_with_shipped_fold
from tests.server.routes import fold_addresses
from tests.server.service_process import check_problem
from tests.server.service_thread import ServiceThread

WORDS = "New folds cannot be accepted: the disk is read-only."


@contextmanager
def read_only(place: Path) -> Generator[None]:
    """Make a directory and its content read-only: by a mount for root, otherwise by modes.

    Where root may not mount, the check for a writable directory is replaced.
    """
    if os.getuid() == 0:
        mount = ["mount", "--bind", "-o", "ro", str(place), str(place)]
        if subprocess.run(mount, capture_output=True).returncode:
            with patch("foldback.server.settings.refuses_writing", return_value=True):
                yield
            return
        undo = ["umount", "--lazy", str(place)]
    else:
        subprocess.run(["chmod", "-R", "a-w", str(place)], check=True)
        undo = ["chmod", "-R", "u+w", str(place)]
    try:
        yield
    finally:
        subprocess.run(undo, check=True)


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[ServiceThread, str]]:
    """Service that was started on a read-only disk, and one of its folds."""
    with service_with_shipped_fold(tmp_path_factory.mktemp("read-only")) as writing:
        (fold,) = writing.http.get("/api/folds").json()["folds"]
    data_dir = writing.data_dir
    with read_only(data_dir), ServiceThread(data_dir, shipped_folds=True).start() as service:
        yield service, fold["id"]


def tree(place: Path) -> list[str]:
    return sorted(str(path) for path in place.rglob("*"))


def test_service_on_read_only_disk_shows_folds_and_writes_nothing(
    stored: tuple[ServiceThread, str],
) -> None:
    service, fold_id = stored
    before = tree(service.data_dir)
    for address in fold_addresses(fold_id):
        answer = service.http.get(address)
        assert answer.status_code < 500 or WORDS in answer.text, (
            f"{address} {answer.status_code} {answer.text[:300]}"
        )
    for part in ("", "/facts", "/bundle", "/batch", "/figures", "/drawing.svg"):
        assert service.http.get(f"/folds/{fold_id}{part}").status_code == 200
    assert WORDS in service.http.get("/").text
    assert tree(service.data_dir) == before
    log = service.log.read_text()
    assert WORDS in log
    assert "Traceback" not in log


def test_change_on_read_only_disk_is_refused_in_the_same_words(
    stored: tuple[ServiceThread, str],
) -> None:
    service, fold_id = stored
    api = f"/api/folds/{fold_id}"
    for method, path in (
        ("POST", "/api/folds"),
        ("POST", "/api/shapes/preview"),
        ("POST", "/gallery/wrench-160"),
        ("POST", f"{api}/movies"),
        ("POST", f"{api}/cancel"),
        ("PATCH", api),
        ("DELETE", api),
    ):
        answer = service.http.request(method, path, data={"x": "y"})
        assert check_problem(answer, 507, "read-only") == WORDS
        page = service.http.request(method, path, headers={"Accept": "text/html"})
        assert (page.status_code, WORDS in page.text) == (507, True)


def test_readiness_and_doctor_on_read_only_disk_say_why(stored: tuple[ServiceThread, str]) -> None:
    service, _ = stored
    ready = service.http.get("/ready")
    assert (ready.status_code, ready.json()["reasons"][0]) == (503, WORDS)
    settings = Settings(data_dir=service.data_dir)
    assert WORDS[:-1] in directory(settings).finding
    assert database(settings).verdict == "ok"


def test_worker_on_read_only_disk_ends_in_one_line(stored: tuple[ServiceThread, str]) -> None:
    service, _ = stored
    worker = [sys.executable, "-P", "-m", "foldback.server.cli", "worker"]
    ended = subprocess.run(worker, env=service.environment, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr.count("\n")) == (1, 1), ended.stderr
    assert "Read-only file system" in ended.stderr


def test_database_with_unfinished_log_on_read_only_disk_is_read(tmp_path: Path) -> None:
    """The write-ahead log of a killed service contains its latest writes."""
    data_directory, copy_directory = tmp_path / "here", tmp_path / "there"
    data_directory.mkdir()
    with sqlite3.connect(data_directory / "rows.db") as live:
        live.execute("PRAGMA journal_mode=WAL")
        live.execute("CREATE TABLE folds (id TEXT)")
        live.execute("INSERT INTO folds VALUES ('latest')")
        live.commit()
        shutil.copytree(data_directory, copy_directory)
    live.close()
    with read_only(copy_directory):
        engine = read_only_engine(f"sqlite:///{copy_directory / 'rows.db'}")
        with engine.connect() as connection:
            rows = connection.exec_driver_sql("SELECT id FROM folds").all()
        engine.dispose()
    assert [row.id for row in rows] == ["latest"]
