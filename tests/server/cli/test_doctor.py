"""The doctor: each thing that it looks at is broken for real, and it says so and what to do."""

from __future__ import annotations

import http.server
import json
import os
import resource
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import sqlalchemy as sa
import typer
from alembic import command
from sqlalchemy.orm import Session

from server.cli.doctor import doctor
from server.doctor import data, drawing, machine
from server.doctor.doctor import CHECKS
from server.doctor.finding import Finding, examine
from server.processes.movie_task import GL_SETTING
from server.settings import Settings
from server.store.schema_version import config
from server.store.tables import engine_for, migrate
from tests.server.cli.test_command_line import foldback
from tests.server.postgres import DATABASES, Postgres
from tests.server.rows import a_fold
from tests.server.service import Service


def settings(tmp_path: Path, **values: Any) -> Settings:
    return Settings(**{"data_dir": tmp_path / "data", **values})


def told(found: Finding, verdict: str, *words: str) -> None:
    """Check what a finding says and its remedy."""
    assert found.verdict == verdict, found
    for word in words:
        assert word in f"{found.found} {found.remedy}"


def powerless() -> list[str]:
    """Root may write anywhere, unless it gives that power up."""
    if os.geteuid() != 0:
        return []
    return ["setpriv", "--bounding-set=-dac_override,-dac_read_search"]


def alone(check: str, *prefix: str, **values: Any) -> Finding:
    """What a check finds in a process of its own, started by another program."""
    code = (
        "import json\nfrom dataclasses import asdict\n"
        "from server.doctor import data, drawing\nfrom server.settings import Settings\n"
        f"print(json.dumps(asdict({check}(Settings(**json.loads({json.dumps(values)!r}))))))"
    )
    done = subprocess.run(
        [*prefix, sys.executable, "-c", code],
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=True,
    )
    return Finding(**json.loads(done.stdout))


@pytest.mark.long
@pytest.mark.processes
def test_doctor_of_a_sound_machine_finds_no_problem_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in os.environ:
        if name.startswith("FOLDBACK_"):
            monkeypatch.delenv(name)
    answer = foldback("doctor", "--json", "--port", "0", "--data-dir", str(tmp_path / "data"))
    found = json.loads(answer.stdout)
    assert answer.returncode == 0, answer.stdout
    assert [finding["name"] for finding in found] == [name for name, _ in CHECKS]
    assert not [f for f in found if f["verdict"] == "problem"]
    assert all(f["remedy"] is None for f in found if f["verdict"] == "ok")
    assert all(f["remedy"] for f in found if f["verdict"] != "ok")
    assert not list(tmp_path.iterdir())


def test_problem_is_told_in_a_line_and_by_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.doctor.doctor.CHECKS", (("database", data.database),))
    (tmp_path / "foldback.db").write_bytes(b"garbage\n" * 1000)
    with pytest.raises(typer.Exit) as ended:
        doctor(data_dir=tmp_path)
    assert ended.value.exit_code == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("problem  database: sqlite:///")
    assert "file is not a database" in line
    assert "restore a backup" in line
    (tmp_path / "foldback.db").unlink()
    doctor(data_dir=tmp_path)


def test_failed_check_does_not_stop_the_others(tmp_path: Path) -> None:
    def broken(settings: Settings) -> Finding:
        raise RuntimeError("boom")

    first, second = examine([("broken", broken), ("clock", machine.clock)], settings(tmp_path))
    assert (first.verdict, first.name) == ("problem", "broken")
    assert "boom" in first.found
    assert second.verdict == "ok"


def test_package_that_is_too_old_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert machine.python(settings(tmp_path)).verdict == "ok"
    old = tmp_path / "numpy-0.1.dist-info"
    old.mkdir()
    (old / "METADATA").write_text("Metadata-Version: 2.1\nName: numpy\nVersion: 0.1\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    told(machine.python(settings(tmp_path)), "problem", "numpy is 0.1, expected")


@pytest.mark.processes
def test_closed_full_or_volatile_data_directory_is_told(tmp_path: Path) -> None:
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    told(
        alone("data.directory", *powerless(), data_dir=str(closed / "data")),
        "problem",
        f"{closed} cannot be written (Permission denied)",
    )
    closed.chmod(0o700)
    # Tests may be in memory, of which it warns.
    assert data.directory(settings(closed)).verdict != "problem"
    told(
        data.directory(settings(tmp_path, min_free_disk_bytes=2**60)),
        "problem",
        "MiB free",
        "expire",
    )
    told(
        data.directory(settings(tmp_path, data_dir="/dev/shm/foldback-nowhere")), "warning", "tmpfs"
    )


def test_missing_and_damaged_databases_are_told(tmp_path: Path, postgres: Postgres) -> None:
    here, file = settings(tmp_path, data_dir=tmp_path), tmp_path / "foldback.db"
    assert data.database(here).verdict == "ok" and not file.exists()
    garbage = b"garbage\n" * 1000
    file.write_bytes(garbage)
    told(data.database(here), "problem", "not a database")
    assert file.read_bytes() == garbage
    url = postgres.database()
    assert data.database(settings(tmp_path, database_url=url)).verdict == "ok"
    gone = url.replace("foldback@", "foldback:geheim@").replace(f":{postgres.port}/", ":1/")
    found = data.database(settings(tmp_path, database_url=gone))
    assert found.verdict == "problem" and "geheim" not in found.line
    missing = data.database(settings(tmp_path, database_url=f"{url}x"))
    assert missing.verdict == "problem" and "does not exist" in missing.found


@pytest.mark.parametrize("kind", DATABASES)
def test_schema_behind_or_ahead_is_told(
    kind: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    url = None if kind == "sqlite" else request.getfixturevalue("postgres").database()
    here = settings(tmp_path, data_dir=tmp_path, database_url=url)
    engine = engine_for(here.store_url)
    with engine.begin() as connection:
        alembic = config()
        alembic.attributes["connection"] = connection
        command.upgrade(alembic, "0001")
    told(data.database(here), "warning", "version 0001, ", "foldback serve")
    migrate(engine)
    assert data.database(here).verdict == "ok"
    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '0099'"))
    told(data.database(here), "problem", "newer")
    engine.dispose()


def test_storage_that_is_no_directory_is_a_problem(tmp_path: Path) -> None:
    here = settings(tmp_path, data_dir=tmp_path)
    here.folds_dir.mkdir()
    assert data.storage(here).verdict == "ok"
    assert not list(here.folds_dir.iterdir())
    here.folds_dir.rmdir()
    here.folds_dir.touch()
    told(data.storage(here), "problem", "NotADirectoryError")


@pytest.fixture
def alien() -> Iterator[int]:
    """The port of a program that is not foldback."""

    class Quiet(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b'{"status": "ok"}')

        def log_message(self, *_: object) -> None:
            pass

    with http.server.HTTPServer(("127.0.0.1", 0), Quiet) as server:
        threading.Thread(target=server.serve_forever).start()
        yield server.server_port
        server.shutdown()


def test_taken_port_and_foreign_address_are_problems(
    tmp_path: Path, alien: int, desk: Service
) -> None:
    told(machine.port(settings(tmp_path, port=alien)), "problem", "another program")
    ours = urlsplit(str(desk.http.base_url)).port
    told(machine.port(settings(tmp_path, port=ours)), "ok", "foldback already answers")
    told(
        machine.port(settings(tmp_path, host="203.0.113.1", port=8123)), "problem", "FOLDBACK_HOST"
    )


@pytest.mark.parametrize(("limit", "verdict"), [(200, "problem"), (512, "warning"), (1024, "ok")])
def test_limit_of_open_files_is_judged(tmp_path: Path, limit: int, verdict: str) -> None:
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (limit, before[1]))
    try:
        found = machine.files(settings(tmp_path))
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert (found.verdict, f"{limit} can be open" in found.found) == (verdict, True)
    assert verdict == "ok" or "ulimit" in (found.remedy or "")


def test_too_little_memory_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert machine.memory(settings(tmp_path, child_memory_bytes=2**28)).verdict == "ok"
    told(
        machine.memory(settings(tmp_path, workers=64, folds_per_worker=64)),
        "warning",
        "4096 folds at once",
    )
    monkeypatch.setattr(machine, "_allowed_bytes", lambda: [1500 * 2**20])
    told(
        machine.memory(settings(tmp_path, child_memory_bytes=2**28)),
        "warning",
        "6 processes that read uploads",
    )


def test_open_host_names_are_a_warning(tmp_path: Path) -> None:
    for verdict, values in (
        ("ok", {}),
        ("warning", {"host": "0.0.0.0"}),
        ("warning", {"allowed_hosts": "*"}),
        ("ok", {"host": "0.0.0.0", "allowed_hosts": "fold.example.org"}),
    ):
        assert machine.names(settings(tmp_path, **values)).verdict == verdict, values


def test_clock_set_back_is_a_warning(tmp_path: Path) -> None:
    here = settings(tmp_path, data_dir=tmp_path)
    engine = engine_for(here.store_url)
    migrate(engine)
    assert machine.clock(here).verdict == "ok"
    with Session(engine) as session, session.begin():
        session.add(a_fold("later", created_at=time.time() + 7200))
    engine.dispose()
    told(data.database(here), "warning", "s apart")
    later = time.time() + 7200
    os.utime(tmp_path / "foldback.db", (later, later))
    told(machine.clock(here), "warning", "2.0 hours")


@pytest.mark.processes
def test_missing_opengl_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(GL_SETTING, "egl")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", str(tmp_path))  # there is no driver
    told(drawing.gl(settings(tmp_path)), "warning", "no movies: egl: ", "apt-get install")
    monkeypatch.setenv(GL_SETTING, "off")
    assert "switched off" in drawing.gl(settings(tmp_path)).found


@pytest.mark.processes
def test_crash_of_opengl_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal\n"
        f"if os.environ.get({GL_SETTING!r}): os.kill(os.getpid(), signal.SIGSEGV)"
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    told(
        drawing.gl(settings(tmp_path)),
        "warning",
        "egl: it crashed (signal 11); osmesa: it crashed (signal 11)",
    )


def test_missing_or_poor_encoder_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, without_ffmpeg: dict[str, str]
) -> None:
    poor = tmp_path / "ffmpeg"
    poor.write_text("#!/bin/sh\necho ' V..... mpeg4   MPEG-4'\n")
    poor.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(poor))
    told(drawing.encoder(settings(tmp_path)), "warning", "without x264")
    for name, value in without_ffmpeg.items():
        monkeypatch.setenv(name, value)
    found = drawing.encoder(settings(tmp_path))
    assert found.verdict == "warning" and "apt install ffmpeg" in (found.remedy or "")
    assert found.found.startswith("movies are GIF only: no ffmpeg is on PATH")


@pytest.mark.processes
@pytest.mark.long
def test_kernels_that_cannot_be_cached_are_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert str(tmp_path) in drawing.kernels(settings(tmp_path)).found
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("HOME", "/proc/nowhere")
    monkeypatch.setenv("XDG_CACHE_HOME", "/proc/nowhere")
    root = Path(__file__).parents[3]
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(root / "planner", tmp_path / "planner", ignore=ignored)
    (tmp_path / "planner" / "kernels").chmod(0o500)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{root}")
    found = alone("drawing.kernels", *powerless())
    (tmp_path / "planner" / "kernels").chmod(0o700)
    assert found.verdict == "problem"
    assert "cannot cache" in found.found
    assert "NUMBA_CACHE_DIR" in (found.remedy or "")
