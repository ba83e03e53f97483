"""Page for operators: its settings, metrics and commands exist."""

import re

import yaml

from docs import make_settings
from foldback.server.cli.admin import admin
from foldback.server.cli.command_line import COMMANDS
from foldback.server.ops.metrics import Metrics
from foldback.server.ops.readiness import Places
from foldback.server.settings import Settings
from foldback.server.store.schema import STATUSES
from foldback.server.store.stats import ServiceCounts
from tests.run_python import ROOT

PAGE = (ROOT / "docs" / "operations.md").read_text(encoding="utf-8")


def test_table_of_settings_is_up_to_date() -> None:
    assert make_settings.with_rows(PAGE) == PAGE, "run `python -m docs.make_settings`"
    for name in Settings.model_fields:
        assert f"| `FOLDBACK_{name.upper()}` |" in PAGE
    assert all(field.description for field in Settings.model_fields.values())


def test_table_of_metrics_and_alerts_name_existing_ones() -> None:
    metric_rows = PAGE.partition("| metric | meaning |")[2].partition("\n\n")[0]
    counts = ServiceCounts(
        folds=dict.fromkeys(STATUSES, 0),
        movies={},
        failures={},
        oldest_queued_s=0.0,
        storage_bytes=0,
        workers=0,
        computed_s=(),
    )
    places = Places(disk="ok", storage="ok", free_bytes=0)
    text = Metrics().text(counts, places, streams=0, target_streams=0).decode()
    metrics = set(re.findall(r"# TYPE (foldback_\w+)", text))
    for name in metrics:
        assert name.endswith("_created") or name.removeprefix("foldback") in metric_rows
    alerts = yaml.safe_load((ROOT / "deploy" / "alerts.yml").read_text(encoding="utf-8"))
    rules = [rule for group in alerts["groups"] for rule in group["rules"]]
    assert len(rules) >= 5
    for rule in rules:
        used = set(re.findall(r"foldback_[a-z_]+[a-z]", rule["expr"]))
        assert {name.removesuffix("_count") for name in used} <= metrics, rule["alert"]
        assert rule["annotations"]["summary"].endswith(".")


def test_page_names_all_admin_commands() -> None:
    offered = {command.name or command.callback.__name__ for command in admin.registered_commands}
    named = set(re.findall(r"^foldback admin (\w+)", PAGE, re.MULTILINE))
    assert offered - {"unpin"} == named
    assert "admin" in COMMANDS
