"""Write the types of the API's responses for the pages' scripts; a test detects outdated ones."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

from foldback.server.app import create_app
from foldback.server.settings import Settings

FILE: Final = Path(__file__).parents[1] / "web" / "api.d.ts"
HEAD: Final = """\
// Answers of the API, from its OpenAPI description: written by `python -m docs.make_api_types`.

declare namespace Api {
"""
PROBLEM: Final = "Fault"
"""Schema of error responses, to which only the lists of responses refer."""
PLAIN: Final = {
    "string": "string",
    "integer": "number",
    "number": "number",
    "boolean": "boolean",
    "null": "null",
}
REFERENCE: Final = re.compile(r'"#/components/schemas/(\w+)"')
Schema = Mapping[str, Any]


def types() -> str:
    """Return the content of the file: an interface for each schema that a response uses."""
    with TemporaryDirectory() as directory:
        api = create_app(Settings(data_dir=Path(directory))).openapi()
    schemas: dict[str, Schema] = api["components"]["schemas"]
    interfaces = (interface(name, schemas[name]) for name in sorted(_used(api, schemas)))
    return f"{HEAD}{''.join(interfaces)}}}\n"


def interface(name: str, schema: Schema) -> str:
    """Return a schema as an interface of TypeScript."""
    required = schema.get("required", ())
    lines = (
        f"    {key}{'' if key in required else '?'}: {type_of(value)};\n"
        for key, value in schema["properties"].items()
    )
    return f"  interface {name} {{\n{''.join(lines)}  }}\n"


def type_of(schema: Schema) -> str:
    """Return a schema as a type of TypeScript.

    Raises:
        KeyError: If a schema is of a kind that this function does not know.
    """
    if (reference := schema.get("$ref")) is not None:
        return str(reference).rpartition("/")[2]
    if (choices := schema.get("anyOf")) is not None:
        return " | ".join(type_of(choice) for choice in choices)
    if (values := schema.get("enum")) is not None:
        return " | ".join(json.dumps(value) for value in values)
    if (value := schema.get("const")) is not None:
        return json.dumps(value)
    if schema["type"] == "array":
        item = type_of(schema["items"])
        return f"({item})[]" if " " in item else f"{item}[]"
    if schema["type"] == "object":
        inner = schema["additionalProperties"]
        return f"Record<string, {'unknown' if inner is True else type_of(inner)}>"
    return PLAIN[schema["type"]]


def _used(api: Schema, schemas: Mapping[str, Schema]) -> set[str]:
    """Return the names of all schemas that JSON responses use, directly or within others."""
    used = {PROBLEM}
    waiting = [PROBLEM, *_named(list(_answers(api)))]
    while waiting:
        name = waiting.pop()
        used.add(name)
        waiting += [used_name for used_name in _named(schemas[name]) if used_name not in used]
    return used


def _answers(api: Schema) -> Iterator[Schema]:
    """Yield the content of each response to a successful request."""
    for path in api["paths"].values():
        for operation in path.values():
            for status, answer in operation["responses"].items():
                if status.startswith("2"):
                    yield answer.get("content", {})


def _named(value: object) -> list[str]:
    """Return the names of the schemas that a part of the description refers to."""
    return REFERENCE.findall(json.dumps(value))


if __name__ == "__main__":
    FILE.write_text(types(), encoding="utf-8")
