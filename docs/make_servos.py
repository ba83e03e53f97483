"""Write the rows of servos in robot.md; a test fails if it is outdated."""

from __future__ import annotations

from pathlib import Path

from foldback.planner.servos.servos import Servo, servos

PAGE = Path(__file__).with_name("robot.md")
BEGIN, END = "<!-- servos -->\n", "<!-- end of servos -->\n"
COLUMNS = (
    "servo",
    "stall torque, N·m",
    "voltage, V",
    "no-load speed, rad/s",
    "mass, g",
    "size, mm",
    "rotation range, °",
)


def markdown_rows() -> str:
    """Return the rows in Markdown: one servo per line, with a link to the source of its data."""
    lines = [f"| {' | '.join((*COLUMNS, 'checked against'))} |", "|---" * (len(COLUMNS) + 1) + "|"]
    return "\n".join([*lines, *map(row, servos())]) + "\n"


def row(servo: Servo) -> str:
    """Return the line of a servo."""
    cells = (
        f'[{servo.maker} {servo.name}]({servo.url} "{servo.title}")',
        f"{servo.stall_nm:.3g}" + (" each of two" if servo.axes == 2 else ""),
        f"{servo.volts:g}",
        f"{servo.no_load_rad_s:.3g}",
        f"{1e3 * servo.mass_kg:.3g}",
        " × ".join(f"{1e3 * side:.3g}" for side in servo.size_m),
        "–" if servo.range_deg is None else f"{servo.range_deg:g}",
        servo.checked,
    )
    return f"| {' | '.join(cells)} |"


def with_rows(page: str) -> str:
    """Return the page with current rows."""
    before, _, page_end = page.partition(BEGIN)
    _, _, after = page_end.partition(END)
    return f"{before}{BEGIN}\n{markdown_rows()}\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(with_rows(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
