"""Backups of real databases and files: their content, and refusals to restore."""

import json
import os
import shutil
import stat
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import pytest
from click.testing import Result
from typer.testing import CliRunner

from server.admin.backup_manifest import MANIFEST, BackupFile, Manifest
from server.cli.admin import admin
from server.settings import Settings
from server.store.folds import NoSuchFoldError, Store
from server.store.tables import engine_for
from tests.case import case
from tests.server.postgres import Postgres
from tests.server.rows import SOMEBODY, a_fold, upgrade
from tests.server.service_thread import copy_tables


@dataclass(frozen=True)
class Site:
    """Settings of one service, as keywords and as variables."""

    data_dir: Path
    database_url: str | None = None
    storage_url: str | None = None

    @property
    def settings(self) -> Settings:
        return Settings(**self.__dict__)

    def run(self, *arguments: str | Path) -> Result:
        given = {f"FOLDBACK_{name.upper()}": str(value) for name, value in self.__dict__.items()}
        given = {name: value for name, value in given.items() if value != "None"}
        return CliRunner().invoke(admin, list(map(str, arguments)), env=given)

    def add(self, fold_id: str) -> None:
        """Add a queued fold with files."""
        aside = self.data_dir / f"aside-{fold_id}"
        (aside / "timeline.zarr").mkdir(parents=True)
        (aside / "input").write_bytes(b"cells of " + fold_id.encode())
        (aside / "timeline.zarr" / "zarr.json").write_bytes(b'{"attributes": {}}')
        copy_tables(self.settings)
        with closing(Store(self.settings)) as store:
            store.add(a_fold(fold_id, status="queued"), SOMEBODY)
            store.folders.adopt(aside, fold_id)

    def input_of(self, fold_id: str) -> bytes:
        with closing(Store(self.settings)) as store:
            return (store.directory(fold_id) / "input").read_bytes()


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
    other = replace(small, data_dir=tmp_path / "other")
    assert other.run("restore", tmp_path / "copy").exit_code == 0
    assert other.input_of("first") == b"cells of first"
    assert stat.S_IMODE((other.data_dir / "foldback.db").stat().st_mode) == 0o600


def test_restore_is_refused_while_the_service_runs_and_from_other_databases(
    small: Site, tmp_path: Path
) -> None:
    copy = tmp_path / "copy"
    small.run("backup", copy)
    with closing(Store(small.settings)) as store:
        assert store.fold("first")
        refused = small.run("restore", "--replace", copy)
    assert refused.exit_code == 1 and "in use" in refused.stderr
    other = replace(small, storage_url="memory://", data_dir=tmp_path / "other")
    assert "expected 'objects'" in other.run("restore", copy).stderr
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
}


def test_restore_of_a_changed_backup_touches_nothing(small: Site, tmp_path: Path) -> None:
    whole = tmp_path / "whole"
    assert small.run("backup", whole).exit_code == 0
    times = {path: path.stat().st_mtime_ns for path in small.data_dir.rglob("*")}
    for name, change in HOSTILE.items():
        with case(name):
            copy = tmp_path / name / "copy"
            shutil.copytree(whole, copy)
            change(copy)
            refused = small.run("restore", "--replace", copy)
            assert refused.exit_code == 1
            assert any(words in refused.stderr for words in ("use another", "admin backup"))
            assert {path: path.stat().st_mtime_ns for path in small.data_dir.rglob("*")} == times
            assert not list(tmp_path.rglob("evil/*"))


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
    assert {row["id"] for table, row in rows if table == "folds"} == {"first", "second"}
    assert not (copy / "folds/first/link").exists()


def test_migration_is_announced_before_it_is_done(tmp_path: Path) -> None:
    site = Site(tmp_path / "data")
    result = site.run("migrate", "--check")
    assert result.exit_code == 3 and "version 0001" in result.stdout
    assert not site.data_dir.exists()
    assert "expected tables to back up" in site.run("backup", tmp_path / "copy").stderr
    site.settings.make_directories()
    engine = engine_for(site.settings.store_url)
    upgrade(engine, "0015")
    result = site.run("migrate", "--check")
    assert result.exit_code == 3
    assert result.stdout == "would migrate the tables of folds to version 0016\n"
    assert site.run("backup", tmp_path / "copy").exit_code == 0  # before the upgrade
    assert "foldback admin migrate" in site.run("list").stderr
    assert site.run("migrate").stdout == "migrated the tables of folds to version 0016\n"
    assert site.run("migrate", "--check").stdout == "All database tables are up to date.\n"
    with engine.begin() as connection:
        connection.exec_driver_sql("UPDATE alembic_version SET version_num = '9999'")
    engine.dispose()
    newer = site.run("migrate", "--check")
    assert newer.exit_code == 1 and "newer foldback" in newer.stderr
