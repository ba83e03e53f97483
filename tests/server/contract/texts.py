"""All texts of the contract by the names of their files, stored beside this module."""

from __future__ import annotations

from pathlib import Path

from tests.server.contract.application import Application
from tests.server.contract.folds import add_folds
from tests.server.contract.interface import help_text, openapi_text
from tests.server.contract.pages import page_texts

STORED = Path(__file__).parent / "stored"
STORE = "run `python -m tests.server.contract --store` if the change is intended"


def texts(data_dir: Path) -> dict[str, str]:
    """Return the texts of an application on an empty data directory."""
    with Application(data_dir) as application:
        add_folds(application.context)
        return {
            "openapi.json": openapi_text(application.description()),
            "help.txt": help_text(),
            **page_texts(application),
        }


def stored() -> dict[str, str]:
    """Return the stored texts."""
    files = (path for path in STORED.rglob("*") if path.is_file())
    return {str(f.relative_to(STORED)): f.read_text(encoding="utf-8") for f in files}


def store(current: dict[str, str]) -> None:
    """Store these texts, and no others."""
    for name in stored().keys() - current.keys():
        (STORED / name).unlink()
    for name, text in current.items():
        (STORED / name).parent.mkdir(parents=True, exist_ok=True)
        (STORED / name).write_text(text, encoding="utf-8")
