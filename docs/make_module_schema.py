"""Write the JSON schema of module files; a test detects an outdated one."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from foldback.planner.chain.module_file import module_schema

FILE: Final = Path(__file__).parent / "module.schema.json"


def schema_text() -> str:
    """Return the text of the file."""
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "foldback-module/1",
    }
    return json.dumps({**head, **module_schema()}, indent=1) + "\n"


if __name__ == "__main__":
    FILE.write_text(schema_text(), encoding="utf-8")
