"""Adverse circumstances: a failing database and a full disk."""

import json
import resource
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import exc

from foldback.server.errors import NoRoom, ServiceError, Unavailable
from foldback.server.http.problems import of_trouble
from foldback.server.processes.limits import ChildLimits, environment_of_child
from foldback.server.store.owner import new_token
from tests.run_python import run_python
from tests.server.processes.test_children import make_child, without_libraries
from tests.server.service_process import SNAKE, FinishedFold, Service, bearer, check_problem
from tests.server.service_thread import ServiceThread

PAGE = {"Accept": "text/html,application/xhtml+xml"}


@pytest.fixture(scope="module")
def broken(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Service, str]]:
    """Service whose database has lost its tables, and the id of a fold that it had."""
    with ServiceThread(tmp_path_factory.mktemp("broken") / "data").start() as service:
        fold_id = service.fold(SNAKE)["id"]
        with sqlite3.connect(service.data_dir / "foldback.db", timeout=60) as database:
            for table in ("folds", "movies"):
                database.execute(f"ALTER TABLE {table} RENAME TO gone_{table}")
        database.close()
        yield service, fold_id


ROUTES = ("", "/events", "/frames", "/exports", "/exports/plan.csv", "/plan.json", "/trajectory")
ROUTES += ("/motors?module_mass=1", "/refolds", "/movies/abc")
CHANGES = (
    ("POST", "/api/folds"),
    ("GET", "/api/folds"),
    ("POST", "/api/folds/{}/cancel"),
    ("DELETE", "/api/folds/{}"),
    ("POST", "/api/folds/{}/movies"),
)


def test_without_a_database_every_route_reports_when_to_retry(broken: tuple[Service, str]) -> None:
    service, fold_id = broken
    for route in ROUTES:
        answer = service.http.get(f"/api/folds/{fold_id}{route}", headers=PAGE)
        check_problem(answer, 503, "no-database", retry=True)
        assert "sqlite" not in answer.text.lower()
    for method, path in CHANGES:
        extra = {"json": {}} if "movies" in path else {"data": {"shape": "mallet-64"}}
        answer = service.http.request(
            method,
            path.format(fold_id),
            headers=bearer("a" * 32),
            **(extra if method == "POST" else {}),
        )
        assert (answer.status_code, answer.json()["code"]) == (503, "no-database"), answer.text


def test_without_a_database_pages_say_so_in_words(broken: tuple[Service, str]) -> None:
    service, fold_id = broken
    for page in ("/", "/gallery", f"/folds/{fold_id}", f"/compare?a={fold_id}&b={fold_id}"):
        answer = service.http.get(page, headers=PAGE)
        assert answer.status_code == 503
        assert answer.headers["content-type"].startswith("text/html")
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert int(answer.headers["retry-after"]) > 0
        for words in ("Temporarily unavailable", "The database does not answer"):
            assert words in answer.text


def test_health_and_metrics_work_without_a_database(broken: tuple[Service, str]) -> None:
    service, _ = broken
    assert service.http.get("/health").status_code == 200
    assert service.http.get("/static/page.css").status_code in (200, 404)
    metrics = service.metrics()  # counters within this process still work
    assert metrics.status_code == 200
    assert "foldback_database_up 0.0" in metrics.text and "foldback_folds{" not in metrics.text


def test_full_disk_refuses_uploads_and_nothing_else(finished: FinishedFold) -> None:
    token = new_token()

    def upload() -> dict[str, Any]:
        data = json.dumps(SNAKE) + 10_000 * " "
        answer = finished.service.upload("snake.json", data, token=token)
        assert answer.status_code == 202, answer.text
        return answer.json()

    fold_id = upload()["id"]
    before = resource.prlimit(finished.service.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(finished.service.process.pid, resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        for data in (b"[" * 3_000_000, b"[" * 10_000):  # during and after the upload
            for path in ("/api/folds", "/api/shapes/preview"):
                answer = finished.http.post(path, files={"file": ("a.json", data)})
                check_problem(answer, 507, "no-room", retry=True)
        assert finished.http.get(finished.page).status_code == 200
    finally:
        resource.prlimit(finished.service.process.pid, resource.RLIMIT_FSIZE, before)
    assert upload()["id"] == fold_id  # the file is stored before the row
    assert [p.name for p in finished.service.data_dir.glob("uploads/*/*")] == []


@pytest.mark.parametrize(
    ("error", "kind"),
    [
        (exc.OperationalError("x", {}, Exception("connection refused")), Unavailable),
        (exc.OperationalError("x", {}, Exception("database or disk is full")), NoRoom),
        (exc.DatabaseError("x", {}, Exception("file is not a database")), Unavailable),
        (exc.InterfaceError("x", {}, Exception("closed")), Unavailable),
        (exc.TimeoutError("QueuePool limit reached"), Unavailable),
        (OSError(28, "No space left on device"), NoRoom),
        (OSError(30, "Read-only file system"), NoRoom),
        (OSError(122, "Disk quota exceeded"), NoRoom),
        (exc.DataError("x", {}, Exception("a fault of ours")), None),
        (exc.IntegrityError("x", {}, Exception("a fault of ours")), None),
        (OSError(2, "No such file or directory"), None),
        (ValueError("x"), None),
    ],
)
def test_outages_differ_from_errors(error: Exception, kind: type[ServiceError] | None) -> None:
    trouble = of_trouble(error)
    assert (trouble and type(trouble)) == kind
    assert trouble is None or (trouble.retry_after_s or 0) > 0


def test_environment_of_a_child_holds_no_secrets() -> None:
    names = ("PATH", "HOME", "LC_ALL", "PYTHONPATH", "LD_LIBRARY_PATH")
    # Kernels of OpenBLAS differ in rounding: a service and a command must choose the same.
    environment = dict.fromkeys((*names, "MUJOCO_GL", "OPENBLAS_CORETYPE"), "/x")
    secrets = ("FOLDBACK_DATABASE_URL", "AWS_SECRET_ACCESS_KEY", "PGPASSWORD")
    secrets += ("AWS_SESSION_TOKEN", "SOME_API_KEY", "OTEL_EXPORTER_OTLP_HEADERS")
    assert environment_of_child({**environment, **dict.fromkeys(secrets, "secret")}) == environment


@pytest.mark.processes
def test_child_has_limits_and_no_secrets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "a-secret")
    monkeypatch.setenv("FOLDBACK_DATABASE_URL", "postgresql://us:a-secret@db/folds")
    limits_of_child = ChildLimits(memory_bytes=2**30, cpu_s=60.0)
    environment_of_tests = without_libraries(tmp_path)
    with make_child("stages", limits_of_child, environment=environment_of_tests) as child:
        assert child._wait_ready(None)
        limits = {
            name: resource.prlimit(child.pid, getattr(resource, f"RLIMIT_{name}"))
            for name in ("CPU", "CORE", "DATA", "FSIZE", "NOFILE")
        }
        with open(f"/proc/{child.pid}/environ", "rb") as file:
            environment = file.read()
        with open(f"/proc/{child.pid}/status") as file:
            status = dict(line.split(":\t", 1) for line in file.read().splitlines())
    assert limits["CORE"] == (0, 0)
    assert limits["CPU"] == (61, 66)
    assert 2**31 < limits["DATA"][0] == limits["DATA"][1] < 2**31 + 2**30
    assert limits["FSIZE"][0] == limits["FSIZE"][1] != resource.RLIM_INFINITY
    assert limits["NOFILE"][0] == limits["NOFILE"][1] <= 512
    assert status["NoNewPrivs"] == "1"
    assert b"a-secret" not in environment
    assert b"PATH=" in environment


@pytest.mark.processes
def test_memory_of_the_service_is_unreadable() -> None:
    """A compromised parser finds no keys in its parent's environment."""
    words = (
        "import ctypes, server.processes.limits as l;"
        "get = lambda: ctypes.CDLL(None).prctl(3, 0, 0, 0, 0);"
        "before = get(); l.keep_secrets(); print(before, get())"
    )
    assert run_python("-c", words).split() == ["1", "0"]
