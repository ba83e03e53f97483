"""Doctor: each checked condition is actually broken, and must be reported with a remedy."""

import json
import os
import resource
import time
from contextlib import closing, nullcontext
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import sqlalchemy as sa
import typer
from sqlalchemy.orm import Session

from foldback.server.cli.doctor import doctor
from foldback.server.doctor import children, data, drawing, machine
from foldback.server.doctor.check_result import CheckResult, examine
from foldback.server.doctor.doctor import CHECKS
from foldback.server.processes.movie_task import GL_SETTING
from foldback.server.settings import Settings
from foldback.server.store import schema
from foldback.server.store.folds import Store
from foldback.server.store.leases import Leases
from foldback.server.store.schema import engine_for, migrate
from tests.case import case
from tests.server.cli.test_command_line import foldback
from tests.server.postgres import Postgres
from tests.server.rows import a_fold, next_migration
from tests.server.service_process import Service
from tests.web.blog import Blog


def settings(tmp_path: Path, **values: Any) -> Settings:
    return Settings(**{"data_dir": tmp_path / "data", **values})


def check_finding(check_result: CheckResult, verdict: str, *words: str) -> None:
    """Check the verdict, the text and the remedy of a finding."""
    assert check_result.verdict == verdict, check_result
    for word in words:
        assert word in f"{check_result.finding} {check_result.remedy}"


@pytest.mark.long
@pytest.mark.processes
@pytest.mark.usefixtures("without_settings")
def test_doctor_of_a_sound_machine_finds_no_problem_and_writes_nothing(tmp_path: Path) -> None:
    answer = foldback("doctor", "--json", "--port", "0", "--data-dir", tmp_path / "data")
    check_values = json.loads(answer.stdout)
    assert answer.returncode == 0, answer.stdout
    assert [finding["name"] for finding in check_values] == [name for name, _ in CHECKS]
    assert not [f for f in check_values if f["verdict"] == "problem"]
    assert all(f["remedy"] is None for f in check_values if f["verdict"] == "ok")
    assert all(f["remedy"] for f in check_values if f["verdict"] != "ok")
    assert not list(tmp_path.iterdir())


def test_problem_is_reported_in_a_line_and_by_the_exit_code(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("foldback.server.doctor.doctor.CHECKS", (("database", data.database),))
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
    def broken(settings: Settings) -> CheckResult:
        raise RuntimeError("boom")

    first, second = examine([("broken", broken), ("clock", machine.clock)], settings(tmp_path))
    assert (first.verdict, first.name) == ("problem", "broken")
    assert "boom" in first.finding
    assert second.verdict == "ok"


def test_package_that_is_too_old_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert machine.python(settings(tmp_path)).verdict == "ok"
    for name, number in (("numpy", "0.1"), ("mujoco", "4.0.0")):
        wrong = tmp_path / f"{name}-{number}.dist-info"
        wrong.mkdir()
        (wrong / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {number}\n")
    assert drawing.mujoco(settings(tmp_path)).verdict == "ok"
    monkeypatch.syspath_prepend(str(tmp_path))
    check_finding(
        machine.python(settings(tmp_path)),
        "problem",
        "numpy has version 0.1, expected",
        "mujoco has version 4.0.0, expected !=4.0.0",
        "pip install 'mujoco",
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))  # the package is new, its library is not
    check_finding(drawing.mujoco(settings(tmp_path)), "problem", "its package 4.0.0", "reinstall")


FINDINGS: tuple[tuple[Any, dict[str, Any], str, str], ...] = (
    (data.directory, {"data_dir": "/proc/foldback"}, "problem", "/proc cannot be written ("),
    (data.directory, {"min_free_disk_bytes": 2**60}, "problem", "MiB free"),
    (data.directory, {"data_dir": "/dev/shm/foldback-nowhere"}, "warning", "tmpfs"),
    (machine.port, {"host": "203.0.113.1", "port": 8123}, "problem", "FOLDBACK_HOST"),
    (machine.memory, {"child_memory_bytes": 2**28}, "ok", ""),
    (machine.memory, {"workers": 64, "folds_per_worker": 64}, "warning", "4096 simultaneous folds"),
    (machine.names, {}, "ok", ""),
    (machine.names, {"host": "0.0.0.0"}, "warning", ""),
    (machine.names, {"allowed_hosts": "*"}, "warning", ""),
    (machine.names, {"host": "0.0.0.0", "allowed_hosts": "fold.example.org"}, "ok", ""),
)
"""Checks with settings, verdict and text; even root cannot write to /proc."""


def test_unsuitable_settings_are_found(tmp_path: Path) -> None:
    for check, values, verdict, words in FINDINGS:
        with case((check.__name__, values)):
            check_finding(check(settings(tmp_path, **values)), verdict, words)
    # Tests may run in a file system in memory, which causes a warning.
    assert data.directory(settings(tmp_path)).verdict != "problem"


def test_missing_and_damaged_databases_are_reported(tmp_path: Path, postgres: Postgres) -> None:
    given_settings, file = settings(tmp_path, data_dir=tmp_path), tmp_path / "foldback.db"
    assert data.database(given_settings).verdict == "ok" and not file.exists()
    garbage = b"garbage\n" * 1000
    file.write_bytes(garbage)
    check_finding(data.database(given_settings), "problem", "not a database")
    assert file.read_bytes() == garbage
    url = postgres.database()
    assert data.database(settings(tmp_path, database_url=url)).verdict == "ok"
    changed = url.replace("foldback@", "foldback:geheim@").replace(f":{postgres.port}/", ":1/")
    database = data.database(settings(tmp_path, database_url=changed))
    assert database.verdict == "problem" and "geheim" not in database.line
    missing = data.database(settings(tmp_path, database_url=f"{url}x"))
    assert missing.verdict == "problem" and "does not exist" in missing.finding


def test_pooler_that_breaks_sessions_is_refused(
    tmp_path: Path, postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pooler lends the same session to two connections, one after the other."""
    url = Settings(database_url=postgres.migrated()).store_url
    schema.check_sessions(url)
    with schema.reading_connection(url) as shared:
        monkeypatch.setattr(schema, "reading_connection", lambda _: nullcontext(shared))
        check_finding(
            data.database(settings(tmp_path, database_url=url)), "problem", "pooler", "keep a"
        )
        with closing(Store(settings(tmp_path, database_url=url))) as store:
            leases = Leases(settings(tmp_path, database_url=url), store)
            with pytest.raises(schema.PoolerError, match="expected that of PostgreSQL itself"):
                leases.take("one", on_notice=lambda: None)


def test_schema_behind_or_ahead_is_reported(tmp_path: Path) -> None:
    given_settings = settings(tmp_path, data_dir=tmp_path)
    engine = engine_for(given_settings.store_url)
    migrate(engine)
    assert data.database(given_settings).verdict == "ok"
    with next_migration(tmp_path):
        check_finding(data.database(given_settings), "warning", "version 0003, ", "foldback serve")
        migrate(engine)
        assert data.database(given_settings).verdict == "ok"
    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '0099'"))
    check_finding(data.database(given_settings), "problem", "newer")
    engine.dispose()


def test_storage_that_is_no_directory_is_a_problem(tmp_path: Path) -> None:
    given_settings = settings(tmp_path, data_dir=tmp_path)
    given_settings.folds_dir.mkdir()
    assert data.storage(given_settings).verdict == "ok"
    assert not list(given_settings.folds_dir.iterdir())
    given_settings.folds_dir.rmdir()
    given_settings.folds_dir.touch()
    check_finding(data.storage(given_settings), "problem", "NotADirectoryError")


def test_port_of_another_program_is_a_problem(tmp_path: Path, blog: Blog, idle: Service) -> None:
    blog.html = '{"status": "ok"}'
    alien = settings(tmp_path, port=blog.server_port)
    check_finding(machine.port(alien), "problem", "another program")
    port = urlsplit(str(idle.http.base_url)).port
    check_finding(machine.port(settings(tmp_path, port=port)), "ok", "foldback is already running")


def test_limit_of_open_files_is_judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for limit, verdict in ((200, "problem"), (512, "warning"), (4096, "ok")):
        monkeypatch.setattr(resource, "getrlimit", lambda _, limit=limit: (64, limit))
        check_result = machine.files(settings(tmp_path))
        assert (check_result.verdict, f"the limit is {limit}" in check_result.finding) == (
            verdict,
            True,
        )
        assert verdict == "ok" or "ulimit" in (check_result.remedy or "")


def test_too_little_memory_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "_allowed_bytes", lambda: [1500 * 2**20])
    little = machine.memory(settings(tmp_path, child_memory_bytes=2**28))
    check_finding(little, "warning", "7 processes that read uploads")


def test_clock_set_back_is_a_warning(tmp_path: Path) -> None:
    given_settings = settings(tmp_path, data_dir=tmp_path)
    engine = engine_for(given_settings.store_url)
    migrate(engine)
    assert machine.clock(given_settings).verdict == "ok"
    with Session(engine) as session, session.begin():
        session.add(a_fold("later", created_at=time.time() + 7200))
    engine.dispose()
    check_finding(data.database(given_settings), "warning", "s apart")
    later = time.time() + 7200
    os.utime(tmp_path / "foldback.db", (later, later))
    check_finding(machine.clock(given_settings), "warning", "2.0 hours")


@pytest.mark.processes
def test_missing_opengl_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(GL_SETTING, "egl")
    monkeypatch.setenv("__EGL_VENDOR_LIBRARY_DIRS", str(tmp_path))  # a driver that does not exist
    check_finding(drawing.gl(settings(tmp_path)), "warning", "be made: egl: ", "apt-get install")
    monkeypatch.setenv(GL_SETTING, "off")
    assert "switched off" in drawing.gl(settings(tmp_path)).finding


@pytest.mark.processes
def test_crash_of_opengl_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal\n"
        f"if os.environ.get({GL_SETTING!r}): os.kill(os.getpid(), signal.SIGSEGV)"
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    crashed = "egl: it crashed (signal 11); osmesa: it crashed (signal 11)"
    check_finding(drawing.gl(settings(tmp_path)), "warning", crashed)


NO_LANDLOCK = "landlock.version = lambda: 0"
NO_SECCOMP = "seccomp.restrict = lambda **_: None"
LINUX_5_19 = "landlock.version = lambda: 2"


@pytest.mark.processes
@pytest.mark.parametrize(
    ("lacks", "verdict", "expected_text"),
    [
        (LINUX_5_19, "ok", "refuses processes that read uploads files of other programs"),
        (NO_LANDLOCK, "warning", "they may use files of other programs"),
        (
            f"{NO_SECCOMP}; {LINUX_5_19}",
            "warning",
            "signals to other programs and sockets and shared memory and links",
        ),
    ],
)
def test_what_the_sandbox_lacks_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lacks: str, verdict: str, expected_text: str
) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    (tmp_path / "sitecustomize.py").write_text(
        f"from foldback.server.processes import landlock, seccomp\n{lacks}\n"
    )
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    check_finding(children.confinement(settings(tmp_path)), verdict, expected_text)


def test_missing_or_poor_encoder_is_a_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, without_ffmpeg: dict[str, str]
) -> None:
    poor = tmp_path / "ffmpeg"
    poor.write_text("#!/bin/sh\necho ' V..... mpeg4   MPEG-4'\n")
    poor.chmod(0o755)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(poor))
    check_finding(drawing.encoder(settings(tmp_path)), "warning", "without x264")
    for name, value in without_ffmpeg.items():
        monkeypatch.setenv(name, value)
    check_result = drawing.encoder(settings(tmp_path))
    assert check_result.verdict == "warning" and "apt install ffmpeg" in (check_result.remedy or "")
    assert check_result.finding.startswith("movies can only be GIF files: no ffmpeg is on PATH")


@pytest.mark.processes
def test_core_that_does_not_suit_the_processor_is_a_problem(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert drawing.core(settings(tmp_path)).finding == "the compiled core computes"
    crash = "import os, signal\nos.kill(os.getpid(), signal.SIGILL)"
    (tmp_path / "sitecustomize.py").write_text(crash)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}")
    check_finding(drawing.core(settings(tmp_path)), "problem", "crashed (signal 4)", "BASELINE=ON")
