"""Backups of real databases and files: their content, and refusals to restore."""

import errno
import json
import os
import re
import shutil
import stat
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import msgspec
import pytest

from foldback.server.admin.backup_manifest import MANIFEST, ROWS, BackupFile, Manifest
from foldback.server.admin.backup_rows import SAVED_KINDS, UNSAVED_KINDS
from foldback.server.admin.database import drop_schema, replacement
from foldback.server.doctor.data import database
from foldback.server.jobs.housekeeping import Housekeeping
from foldback.server.store.folds import NoSuchFoldError, Store
from foldback.server.store.schema import Base, engine_for, migrate
from foldback.server.store.staged_files import StagedFolders
from tests.case import case
from tests.server.backups import Site
from tests.server.postgres import Postgres
from tests.server.rows import SOMEBODY, a_fold, next_migration


@pytest.fixture
def small(tmp_path: Path) -> Site:
    site = Site(tmp_path / "small")
    site.add("first")
    return site


@pytest.fixture
def large(tmp_path: Path, postgres: Postgres, bucket_url: str) -> Site:
    site = Site(tmp_path / "large", postgres.migrated(), bucket_url)
    site.add("first")
    return site


@pytest.mark.parametrize("kind", ["small", pytest.param("large", marks=pytest.mark.processes)])
def test_restored_service_equals_the_original(
    kind: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    site: Site = request.getfixturevalue(kind)
    copy = tmp_path / "copy"
    done = site.run("backup", copy)
    assert done.exit_code == 0, done.output
    for path in copy.rglob("*"):
        assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0 or path.is_dir(), path
    assert stat.S_IMODE(copy.stat().st_mode) == 0o700
    assert site.run("backup", copy).exit_code == 1  # existing data are not overwritten
    site.add("later")
    refused = site.run("restore", copy)
    assert refused.exit_code == 1 and "--replace" in refused.stderr
    assert site.input_of("later")
    done = site.run("restore", "--replace", copy)
    assert done.exit_code == 0, done.output
    assert site.input_of("first") == b"cells of first"
    with pytest.raises(NoSuchFoldError):
        site.input_of("later") if kind == "large" else Store(site.settings).fold("later")
    assert not (site.data_dir / "folds" / "later").exists()
    assert json.loads(site.run("show", "first", "--json").stdout)["job"] == "queued"
    assert site.run("migrate", "--check").exit_code == 0


def test_restore_into_an_empty_directory_needs_no_permission(small: Site, tmp_path: Path) -> None:
    small.run("backup", tmp_path / "copy")
    other_settings = replace(small, data_dir=tmp_path / "other")
    assert other_settings.run("restore", tmp_path / "copy").exit_code == 0
    assert other_settings.input_of("first") == b"cells of first"
    assert stat.S_IMODE((other_settings.data_dir / "foldback.db").stat().st_mode) == 0o600


def test_restore_is_refused_while_the_service_runs_and_from_other_databases(
    small: Site, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    small.run("backup", copy)
    with closing(Store(small.settings)) as store:
        assert store.fold("first")
        refused = small.run("restore", "--replace", copy)
    assert refused.exit_code == 1 and "in use" in refused.stderr
    other_settings = replace(small, storage_url="memory://", data_dir=tmp_path / "other")
    assert "expected 'objects'" in other_settings.run("restore", copy).stderr
    manifest = Manifest.read((copy / MANIFEST).read_bytes())
    (copy / MANIFEST).write_bytes(msgspec.structs.replace(manifest, schema="9999").text())
    assert "version 9999" in small.run("restore", copy).stderr


INPUT = "folds/first/input"


def _linked(copy: Path) -> None:
    (copy / INPUT).rename(copy.parent / "secret")
    (copy / INPUT).symlink_to(copy.parent / "secret")


def _linked_folder(copy: Path) -> None:
    (copy / "folds").rename(copy.parent / "elsewhere")
    (copy / "folds").symlink_to(copy.parent / "elsewhere")


def _pipe(copy: Path) -> None:
    (copy / INPUT).unlink()
    os.mkfifo(copy / INPUT)


def _manifest(**values: object) -> Callable[[Path], None]:
    """Return a change that sets members of a manifest."""

    def change(copy: Path) -> None:
        manifest = json.loads((copy / MANIFEST).read_text())
        (copy / MANIFEST).write_text(json.dumps(manifest | values))

    return change


def _file_of(size: int) -> dict[str, object]:
    return {"name": INPUT, "bytes": size, "sha256": "0" * 64}


def _rows(change: Callable[[str], str]) -> Callable[[Path], None]:
    """Return a change of the rows' text, with its new digest."""

    def change_all(copy: Path) -> None:
        text = (copy / ROWS).read_text()
        assert change(text) != text
        (copy / ROWS).write_text(change(text))
        with open(copy / ROWS, "rb") as file:
            rows = BackupFile.of(ROWS, file)
        manifest = Manifest.read((copy / MANIFEST).read_bytes())
        (copy / MANIFEST).write_bytes(msgspec.structs.replace(manifest, rows=rows).text())

    return change_all


def _value(name: str, text: str) -> Callable[[Path], None]:
    """Return a change of a column in the first row of a fold."""
    column = re.compile(rf'"{name}":("[^"]*"|[\w.]+)')
    return _rows(lambda rows: column.sub(lambda _: f'"{name}":{text}', rows, count=1))


def _added(*rows: object) -> Callable[[Path], None]:
    return _rows(lambda text: text + "".join(json.dumps(row) + "\n" for row in rows))


def _movie(**values: object) -> object:
    movie = {
        **{"fold_id": "first", "id": "a", "job": "first.a.b.mp4", "wishes": {}, "visitor": ""},
        **{"token_hash": "", "status": "ready", "frames_done": 1, "problem": None, "worker": None},
        **{"created_at": 1.0, "bytes": 0, "of_owner": False, "losses": 0},
    }
    return ["movies", movie | values]


def _named(name: str) -> Callable[[Path], None]:
    """Return a change that adds an existing file elsewhere, with its digest, to a manifest."""

    def change(copy: Path) -> None:
        (copy.parent / "evil").write_bytes(b"evil")
        with open(copy.parent / "evil", "rb") as file:
            evil = msgspec.structs.replace(BackupFile.of("", file), name=name)
        manifest = Manifest.read((copy / MANIFEST).read_bytes())
        files = (*manifest.files, evil)
        changed = {"rows": evil} if "rows" in name else {"files": files}
        (copy / MANIFEST).write_bytes(msgspec.structs.replace(manifest, **changed).text())

    return change


HOSTILE: dict[str, Callable[[Path], object]] = {
    "changed": lambda copy: (copy / INPUT).write_bytes(b"cells of fIrst"),
    "missing": lambda copy: (copy / INPUT).unlink(),
    "linked": _linked,
    "linked folder": _linked_folder,
    "pipe": _pipe,
    "unfinished": lambda copy: (copy / MANIFEST).unlink(),
    "above": _named("folds/first/../../../evil"),
    "absolute": _named("/etc/evil"),
    "beside": _named("../evil"),
    "no fold": _named("folds/../evil"),
    "hidden": _named("folds/first/.evil"),
    "line": _named("folds/first/a\nb"),
    "database": _named("../rows.jsonl"),
    "twice": _named("folds/first/input"),
    "movie": _named("movies/first/a.mp4"),
    "huge file": _manifest(files=[_file_of(2**50)]),
    "impossible file": _manifest(files=[_file_of(2**70)]),
    "negative file": _manifest(files=[_file_of(-1)]),
    "no version": _manifest(foldback="\x1b[2J"),
    "time": _manifest(created_at=1e300),
    "storage": _manifest(storage="program"),
    "more members": _manifest(script="rm"),
    "no row": _rows(lambda text: ""),
    "other kind": _added(["sqlite_master", {"sql": "CREATE TRIGGER t"}]),
    "version row": _added(["alembic_version", {"version_num": "1"}]),
    "worker": _added(["workers", {"name": "a"}]),
    "no array": _rows(lambda text: text + "DROP TABLE folds;\n"),
    "cut": _rows(lambda text: text[:-9]),
    "deep": _rows(lambda text: text.replace('"progress":{}', f'"progress":{"[" * 9999}', 1)),
    "surrogate": _value("name", r'"\ud800"'),
    "column": _value("name", '"a","evil":1'),
    "text for a number": _value("modules", '"16"'),
    "large number": _value("modules", str(2**40)),
    "infinite": _value("created_at", "1e999"),
    "time without a date": _value("created_at", "1e12"),
    "long text": _value("module", '"' + "x" * 99 + '"'),
    "null": _value("module", "null"),
    "path as id": _value("id", '"../../evil"'),
    "status": _value("status", '"evil"'),
    "long row": _value("name", '"' + "x" * (9 << 20) + '"'),
    "path as movie": _added(_movie(job="a./../../evil")),
    "movie of no fold": _added(_movie(fold_id="evil")),
    "row twice": _added(_movie(), _movie()),
}


@pytest.mark.slow
def test_restore_of_a_changed_backup_touches_nothing(small: Site, tmp_path: Path) -> None:
    whole_backup = tmp_path / "whole"
    assert small.run("backup", whole_backup).exit_code == 0
    before = small.state()
    for name, change in HOSTILE.items():
        with case(name):
            copy = tmp_path / name / "copy"
            shutil.copytree(whole_backup, copy)
            change(copy)
            refused = small.run("restore", "--replace", copy)
            assert refused.exit_code == 1
            stderr = refused.stderr
            print(name, "|", stderr.strip())
            assert any(w in stderr for w in ("use another", "admin backup", "free some space")), (
                stderr
            )
            assert stderr.replace("\n", "").isprintable()
            assert small.state() == before
            assert not small.staged()
            assert not list(tmp_path.rglob("evil/*"))


@pytest.mark.processes
def test_restore_of_changed_rows_into_postgresql_touches_nothing(
    large: Site, tmp_path: Path
) -> None:
    before = large.state()
    for name in ("cut", "large number", "movie of no fold", "row twice", "NUL"):
        with case(name):
            copy = tmp_path / name
            assert large.run("backup", copy).exit_code == 0
            (HOSTILE | {"NUL": _value("name", r'"\u0000"')})[name](copy)
            refused = large.run("restore", "--replace", copy)
            assert refused.exit_code == 1 and "use another" in refused.stderr
            assert large.state() == before and not large.staged()


def test_backup_in_an_older_format_is_refused(small: Site, tmp_path: Path) -> None:
    (tmp_path / MANIFEST).write_text('{"format": 1, "files": []}')
    stderr = small.run("restore", "--replace", tmp_path).stderr
    assert "format 1, expected format 2; restore it with the version" in stderr


def test_folds_without_files_are_left_out(small: Site, tmp_path: Path) -> None:
    with closing(Store(small.settings)) as store:
        store.add(a_fold("deleted"), SOMEBODY)
        store.add(a_fold("cancelled", status="cancelled"), SOMEBODY)
    assert small.run("backup", tmp_path / "copy").exit_code == 0
    done = small.run("restore", "--replace", tmp_path / "copy")
    assert done.exit_code == 0 and "Left out 1 folds" in done.stdout
    listed = {row["id"] for row in json.loads(small.run("list", "--json").stdout)}
    assert listed == {"first", "cancelled"}


def test_every_table_is_in_a_backup_or_left_out_on_purpose() -> None:
    assert {*SAVED_KINDS, *UNSAVED_KINDS} == set(Base.metadata.tables)


@pytest.mark.processes
def test_backup_is_restored_into_the_other_kind_of_database(
    small: Site, tmp_path: Path, postgres: Postgres
) -> None:
    with closing(Store(small.settings)) as store:
        secret = store.secret("signing", bytes(range(200, 232)))
        store.add(
            a_fold("large", seed=2**32 - 1, module_size=0.1, progress={"a": [1, None]}), SOMEBODY
        )
        (store.directory("large")).mkdir()
        (store.directory("large") / "input").write_bytes(b"cells")
    before = small.state()
    assert small.run("backup", tmp_path / "first").exit_code == 0
    # A role that owns its database and is no superuser.
    other_settings = replace(small, data_dir=tmp_path / "other", database_url=postgres.owned())
    for site, copy in ((other_settings, "first"), (small, "second")):
        done = site.run("restore", "--replace", tmp_path / copy)
        assert done.exit_code == 0, done.output
        assert site.state() == before
        with closing(Store(site.settings)) as store:
            assert store.secret("signing", bytes(range(200, 232))) == secret
        if site is other_settings:
            assert other_settings.run("backup", tmp_path / "second").exit_code == 0


@pytest.mark.processes
@pytest.mark.parametrize("kind", ["small", "large"])
def test_second_restore_at_the_same_time_is_refused(
    kind: str, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    site: Site = request.getfixturevalue(kind)
    assert site.run("backup", tmp_path / "copy").exit_code == 0
    before = site.state()
    with replacement(site.settings.store_url) as connection:
        refused = site.run("restore", "--replace", tmp_path / "copy")
        drop_schema(connection)
    assert refused.exit_code == 1 and "in use" in refused.stderr
    assert site.state() == before


def test_unfinished_restore_is_finished_by_the_next_command(
    small: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert small.run("backup", tmp_path / "copy").exit_code == 0
    small.add("later")

    def fail(*_: object) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO), "disk")

    with monkeypatch.context() as patch:
        patch.setattr(StagedFolders, "move_into_place", fail)
        halfway = small.run("restore", "--replace", tmp_path / "copy")
        assert halfway.exit_code == 1 and "not in place yet (disk: " in halfway.stderr
        assert "disk cannot be used" in small.run("list").stderr
    assert "unfinished restore" in small.run("backup", tmp_path / "other").stderr
    assert "unfinished restore" in database(small.settings).finding
    assert not (tmp_path / "other" / MANIFEST).exists()
    (number,) = small.staged()
    assert [row["id"] for row in json.loads(small.run("list", "--json").stdout)] == ["first"]
    assert not small.staged() and not (small.data_dir / "folds" / "later").exists()
    assert number


def test_sweep_deletes_what_ended_restores_have_left(small: Site) -> None:
    with closing(Store(small.settings)) as store:
        StagedFolders(small.settings.folds_dir, 7).write("folds/first/input", BytesIO(b"cells"))
        assert small.staged() == {7}
        Housekeeping(small.settings, store).sweep_orphans()
        assert not small.staged() and small.input_of("first") == b"cells of first"


def test_damaged_database_is_left_to_the_operator(small: Site, tmp_path: Path) -> None:
    assert small.run("backup", tmp_path / "copy").exit_code == 0
    path = small.data_dir / "foldback.db"
    path.write_bytes(b"no database" * 1000)
    stderr = small.run("restore", "--replace", tmp_path / "copy").stderr
    assert f"mv {path} {path}.damaged" in stderr
    path.rename(f"{path}.damaged")
    assert small.run("restore", "--replace", tmp_path / "copy").exit_code == 0
    assert small.input_of("first") == b"cells of first"


def test_backup_holds_the_latest_rows_and_no_links(small: Site, tmp_path: Path) -> None:
    copy, secret = tmp_path / "copy", tmp_path / "secret"
    secret.write_text("secret")
    (small.data_dir / "folds" / "first" / "link").symlink_to(secret)
    with closing(Store(small.settings)) as store:
        store.add(a_fold("second"), SOMEBODY)  # the row is in the write-ahead log only
        done = small.run("backup", copy)
        assert done.exit_code == 0, done.output
        store.add(a_fold("third"), SOMEBODY)
    rows = map(json.loads, (copy / "rows.jsonl").read_text().splitlines())
    assert {row["id"] for kind, row in rows if kind == "folds"} == {"first", "second"}
    assert not (copy / "folds/first/link").exists()


def test_migration_is_announced_before_it_is_done(tmp_path: Path) -> None:
    site = Site(tmp_path / "data")
    result = site.run("migrate", "--check")
    assert result.exit_code == 3 and "version 0003" in result.stdout
    assert not site.data_dir.exists()
    assert "expected rows to back up" in site.run("backup", tmp_path / "copy").stderr
    site.settings.make_directories()
    engine = engine_for(site.settings.store_url)
    migrate(engine)
    engine.dispose()
    current = "The database is up to date.\n"
    with next_migration(tmp_path):
        result = site.run("migrate", "--check")
        assert result.exit_code == 3
        assert result.stdout == "would migrate the database to version 0004\n"
        assert site.run("backup", tmp_path / "copy").exit_code == 0  # before the upgrade
        assert "foldback admin migrate" in site.run("list").stderr
        assert site.run("migrate").stdout == "migrated the database to version 0004\n"
        assert site.run("migrate", "--check").stdout == current
        assert site.run("restore", "--replace", tmp_path / "copy").exit_code == 0
        assert site.run("migrate", "--check").stdout == current
    newer = site.run("migrate", "--check")
    assert newer.exit_code == 1 and "newer foldback" in newer.stderr
