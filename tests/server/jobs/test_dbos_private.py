"""Private names of dbos that are leaned on are still there, and in one file only."""

from __future__ import annotations

import inspect
import re
import tomllib
from collections.abc import Callable
from importlib import import_module
from importlib.metadata import version
from itertools import chain
from pathlib import Path
from typing import Final

import pytest
from packaging.requirements import Requirement

ROOT: Final = Path(__file__).parents[3]
LOOK: Final = "dbos has renamed it: see what does the same now, for server/jobs/dbos_private.py"
TAKING: Final = {
    ("dbos._context", "current_owner_xid"): ["workflow_id"],
    ("dbos._dbos", "_get_dbos_instance"): [],
    ("dbos._dbos", "DBOS._recover_pending_workflows"): ["executor_ids"],
    ("dbos._migration", "get_migration_versions"): ["engine", "schema", "use_listen_notify"],
    ("dbos._migration", "get_sqlite_migration_versions"): ["engine"],
    ("dbos._sys_db", "SystemDatabase._check_owner_txn"): [
        "self",
        "conn",
        "workflow_id",
        "owner_xid",
    ],
    ("dbos._sys_db", "SystemDatabase._wf"): ["self", "table", "workflow_id"],
    ("dbos._sys_db", "SystemDatabase._now_ms_sql"): ["self"],
    ("dbos._sys_db", "SystemDatabase.reenqueue_for_recovery"): [
        "self",
        "workflow_id",
        "executor_ids",
        "recovery_queue_name",
    ],
}


def found(module: str, name: str) -> object:
    try:
        there: object = import_module(module)
        for part in name.split("."):
            there = getattr(there, part)
    except (ImportError, AttributeError):
        pytest.fail(f"{module} has no {name}; {LOOK}")
    return there


@pytest.mark.parametrize(("place", "names"), TAKING.items(), ids=lambda item: str(item[-1:]))
def test_what_is_called_is_called_so_and_takes_what_it_is_given(
    place: tuple[str, str], names: list[str]
) -> None:
    called = found(*place)
    assert isinstance(called, Callable), f"{place} is no function; {LOOK}"
    taken = list(inspect.signature(called).parameters)
    assert taken[: len(names)] == names, f"{place} takes {taken}, expected {names} first; {LOOK}"


def test_what_is_looked_up_is_called_so() -> None:
    assert isinstance(found("dbos._utils", "INTERNAL_QUEUE_NAME"), str)
    assert isinstance(found("dbos._dbos", "DBOS._sys_db"), property)
    made = inspect.getsource(import_module("dbos._dbos").DBOS.__init__)
    name = "background_thread_stop_events: List[threading.Event]"
    assert f"self.{name}" in made, f"DBOS makes no {name}; {LOOK}"


def test_no_other_file_leans_on_them() -> None:
    private = re.compile(r"\bdbos\._|\bDBOS\._|\._sys_db\b|_get_dbos_instance|_stop_events\b")
    leaning = {
        path.relative_to(ROOT).as_posix()
        for path in (ROOT / "server").rglob("*.py")
        if private.search(path.read_text(encoding="utf-8"))
    }
    assert leaning == {"server/jobs/dbos_private.py"}


def test_the_version_is_pinned_to_the_one_that_is_tested() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    lines = [*project["dependencies"], *chain(*project["optional-dependencies"].values())]
    pins = [Requirement(line) for line in lines if line.startswith("dbos")]
    assert pins and {str(pin.specifier) for pin in pins} == {f"=={version('dbos')}"}
