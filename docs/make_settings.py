"""Write the rows of settings in operations.md; a test fails if it is outdated."""

from __future__ import annotations

from pathlib import Path

from pydantic.fields import FieldInfo

from foldback.server.settings import MIB_BYTES, Settings

PAGE = Path(__file__).with_name("operations.md")
BEGIN, END = "<!-- settings -->\n", "<!-- end of settings -->\n"


def markdown_rows() -> str:
    """Return the rows in Markdown: one setting per line."""
    lines = ["| setting | default | meaning |", "|---|---|---|"]
    for name, field in Settings.model_fields.items():
        words = " ".join((field.description or "").split()).replace("|", "\\|")
        lines.append(f"| `FOLDBACK_{name.upper()}` | {default(name, field)} | {words} |")
    return "\n".join(lines) + "\n"


def default(name: str, field: FieldInfo) -> str:
    """Return a default value as text for people."""
    value = field.default
    if value is None or value in ((), ""):
        return "–"
    if isinstance(value, tuple):
        return f"`{','.join(value)}`"
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"
    if name.endswith("_bytes") and value % MIB_BYTES == 0:
        return f"`{value}` ({value // MIB_BYTES} MiB)"
    return f"`{value:g}`" if isinstance(value, float) else f"`{value}`"


def with_rows(page: str) -> str:
    """Return the page with current rows."""
    before, _, page_end = page.partition(BEGIN)
    _, _, after = page_end.partition(END)
    return f"{before}{BEGIN}\n{markdown_rows()}\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(with_rows(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
