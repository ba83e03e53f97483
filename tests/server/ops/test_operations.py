"""The page for operators says what is there."""

from __future__ import annotations

import importlib.util
import re
import sqlite3
from pathlib import Path
from types import ModuleType

import pytest

from server.cli.command_line import COMMANDS
from server.operate.admin import admin
from server.ops.metrics import Metrics
from server.settings import Settings
from server.store.folds import Store
from tests.server.rows import a_fold

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture(scope="module")
def page() -> str:
    return (DOCS / "operations.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_settings", DOCS / "make_settings.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_table_of_settings_is_that_of_the_code(page: str, maker: ModuleType) -> None:
    assert maker.with_table(page) == page, "run `python docs/make_settings.py`"
    for name in Settings.model_fields:
        assert f"| `FOLDBACK_{name.upper()}` |" in page
    assert all(field.description for field in Settings.model_fields.values())


def test_the_figures_are_those_that_are_told(page: str) -> None:
    shown = page.partition("| metric | meaning |")[2].partition("\n\n")[0]
    text = Metrics().text(None, streams=0, robots=0).decode()
    for name in re.findall(r"# TYPE (foldback_\w+)", text):
        if not name.endswith("_created"):
            assert name in shown or name.removeprefix("foldback") in shown


def test_the_commands_are_there(page: str) -> None:
    offered = {command.name or command.callback.__name__ for command in admin.registered_commands}
    told = set(re.findall(r"^foldback admin (\w+)", page, re.MULTILINE))
    assert offered - {"unpin"} == told
    assert "admin" in COMMANDS


def test_a_backup_of_a_running_database_is_whole(tmp_path: Path) -> None:
    """As the page says: SQLite's own backup, while the service has the database open."""
    store = Store(Settings(data_dir=tmp_path / "data"))
    store.add(a_fold("kept"), "token")
    (tmp_path / "again").mkdir()
    with (
        sqlite3.connect(tmp_path / "data" / "foldback.db") as running,
        sqlite3.connect(tmp_path / "again" / "foldback.db") as backup,
    ):
        running.backup(backup)
    running.close()
    backup.close()
    store.add(a_fold("later"), "token")
    store.close()
    restored = Store(Settings(data_dir=tmp_path / "again"))
    assert restored.fold("kept").id == "kept"
    assert restored.owns("kept", "token")
    assert len(restored.list_owned("token")) == 1
    restored.close()
