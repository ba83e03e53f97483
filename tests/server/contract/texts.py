"""All texts of the contract by the names of their files, stored beside this module."""

from pathlib import Path

from tests.server.contract.folds import add_folds
from tests.server.contract.interface import help_text, openapi_text
from tests.server.contract.pages import page_texts
from tests.server.rows import store_of
from tests.server.service_thread import ServiceThread

STORED = Path(__file__).parent / "stored"
STORE = "run `python -m tests.server.contract --store` if the change is intended"


def texts(data_dir: Path) -> dict[str, str]:
    """Return the texts of a service on an empty data directory."""
    with ServiceThread(data_dir).start() as service, store_of(service) as store:
        service.http.headers["Host"] = "127.0.0.1:8000"  # independent of the port
        add_folds(store)
        return {
            "openapi.json": openapi_text(service.http.get("/api/openapi.json").json()),
            "help.txt": help_text(),
            **page_texts(service.http),
        }


def stored() -> dict[str, str]:
    """Return the stored texts."""
    files = (path for path in STORED.rglob("*") if path.is_file())
    return {str(f.relative_to(STORED)): f.read_text(encoding="utf-8") for f in files}


def store(current: dict[str, str]) -> None:
    """Store these texts, and remove all others."""
    for name in stored().keys() - current.keys():
        (STORED / name).unlink()
    for name, text in current.items():
        (STORED / name).parent.mkdir(parents=True, exist_ok=True)
        (STORED / name).write_text(text, encoding="utf-8")
