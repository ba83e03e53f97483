"""Writes the table of settings in operations.md anew; a test tells when that is due."""

from __future__ import annotations

from pathlib import Path

from pydantic.fields import FieldInfo

from server.settings import MIB_BYTES, Settings

PAGE = Path(__file__).with_name("operations.md")
BEGIN, END = "<!-- settings -->\n", "<!-- end of settings -->\n"


def table() -> str:
    """The table, in Markdown: a setting a line."""
    lines = ["| setting | default | meaning |", "|---|---|---|"]
    for name, field in Settings.model_fields.items():
        words = " ".join((field.description or "").split()).replace("|", "\\|")
        lines.append(f"| `FOLDBACK_{name.upper()}` | {default(name, field)} | {words} |")
    return "\n".join(lines) + "\n"


def default(name: str, field: FieldInfo) -> str:
    """A default as people write it."""
    value = field.default
    if value is None or value == ():
        return "–"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if name.endswith("_bytes") and value % MIB_BYTES == 0:
        return f"`{value}` ({value // MIB_BYTES} MiB)"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def with_table(page: str) -> str:
    """The page with the table as it should be."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{table()}\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
