import re

import pytest

from foldback.server.settings import Settings
from tests.deploy.files import DEPLOY, EXAMPLES, settings_named


@pytest.mark.parametrize("name", [*EXAMPLES, "../docs/deploy.md"])
def test_named_settings_exist(name: str) -> None:
    expected = {name.upper() for name in Settings.model_fields}
    assert settings_named((DEPLOY / name).read_text()) <= expected


@pytest.mark.parametrize("name", ["compose.example.env", "systemd/foldback.env"])
def test_example_settings_are_valid(name: str) -> None:
    lines = (DEPLOY / name).read_text().splitlines()
    # Settings that are commented out are examples as well.
    matches = [re.fullmatch(r"#?FOLDBACK_([A-Z_]+)=(\S+)", line) for line in lines]
    arguments = [
        (setting_match[1].lower(), setting_match[2]) for setting_match in matches if setting_match
    ]
    assert len(arguments) >= 5
    for setting, value in arguments:
        Settings(**{setting: value})  # pyright: ignore[reportArgumentType]


def test_all_deploy_files_are_checked() -> None:
    names = {str(p.relative_to(DEPLOY)) for p in DEPLOY.rglob("*") if p.is_file()}
    assert names - {"systemd/foldback.sysusers"} == set(EXAMPLES)


def test_examples_offer_the_same_choices() -> None:
    compose, units = (
        settings_named((DEPLOY / name).read_text())
        for name in ("compose.yaml", "systemd/foldback.env")
    )
    shared = {"IMPRINT_URL", "EMBED_ORIGINS", "METRICS_TOKEN", "KEEP_DAYS", "STORAGE_BYTES"}
    assert shared <= compose & units
