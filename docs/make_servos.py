"""Writes the table of servos in robot.md anew; a test tells when that is due."""

from __future__ import annotations

from pathlib import Path

from planner.robot.servos import Servo, servos

PAGE = Path(__file__).with_name("robot.md")
BEGIN, END = "<!-- servos -->\n", "<!-- end of servos -->\n"
COLUMNS = (
    "servo",
    "stall torque, N·m",
    "at, V",
    "no load, rad/s",
    "mass, g",
    "size, mm",
    "range, °",
)


def table() -> str:
    """The table, in Markdown: a servo a line, with a link to what its figures are from."""
    lines = [f"| {' | '.join((*COLUMNS, 'checked against'))} |", "|---" * (len(COLUMNS) + 1) + "|"]
    return "\n".join([*lines, *map(row, servos())]) + "\n"


def row(servo: Servo) -> str:
    """What is told of one."""
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


def with_table(page: str) -> str:
    """The page with the table as it should be."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{table()}\n{END}{after}"


if __name__ == "__main__":
    PAGE.write_text(with_table(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
