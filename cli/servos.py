"""``foldback servos``: list the servos that suit a torque, with the module sizes for each."""

from __future__ import annotations

import json
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import read_plan, refuse
from foldback.cli.options import AsJson
from foldback.planner.chain.cantilever_statics import GRAVITY_M_S2
from foldback.planner.errors import InputError
from foldback.planner.servos.module_materials import CASINGS, Casing, casing_named
from foldback.planner.servos.servos import MIN_SERVO_RANGE_DEG, Servo, servo_named
from foldback.planner.servos.servos import servos as all_servos
from foldback.planner.servos.sizing import (
    PERMANENT_TORQUE_SHARE,
    Fit,
    LargestShape,
    PitchRange,
    find_suitable_servos,
    largest_shape,
    suitable_pitches,
    total_turn_rad,
)


def servos(
    *,
    torque: Annotated[
        float, typer.Option(help="Torque of a hinge in w·p (module weight × pitch).")
    ],
    pitch_mm: Annotated[float, typer.Option(help="Distance between modules, mm.")],
    material: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help=f"Material of a module: {', '.join(CASINGS)}, or a density in kg/m³.",
        ),
    ] = "pla-box",
    mass_g: Annotated[
        float | None,
        typer.Option(
            help="Mass of a module with its servos, g. Default: computed from the material."
        ),
    ] = None,
    share: Annotated[
        float,
        typer.Option(
            help="Share of the stall torque that a servo can hold continuously.", show_default="1/3"
        ),
    ] = PERMANENT_TORQUE_SHARE,
    gravity: Annotated[float, typer.Option(help="Gravity in m/s².")] = GRAVITY_M_S2,
    only: Annotated[
        str | None, typer.Option("--servo", metavar="NAME", help="Check only this servo.")
    ] = None,
    shapes: Annotated[
        list[str] | None,
        typer.Option(
            "--shape",
            metavar="NAME=TORQUE",
            help="Name of a shape and its torque, w·p: also list servos for this shape; "
            "repeatable.",
        ),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="Folder of a fold: also show how fast each servo can fold it."
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List servos that are strong enough for a torque. Exits with 3 if there are none."""
    try:
        pitch_m = 1e-3 * pitch_mm
        casing = _casing(material, mass_g, pitch_m)
        among = all_servos() if only is None else (servo_named(only),)
        figures = _figures(shapes or [])
        sizing = _sized(torque, pitch_m, casing, share, gravity, among, figures)
        turned = None if plan is None else total_turn_rad(read_plan(plan).joint_angles_rad)
    except InputError as error:
        refuse(error, as_json)
    rows = [sizing.row(fit, turned) for fit in sizing.fits]
    suitable = {name: sizing.suitable(name) for name in figures}
    if as_json:
        print(json.dumps({**sizing.as_dict(), "servos": rows, "shapes": suitable}), flush=True)
    else:
        _show(sizing, rows, figures, suitable)
    if not any(fit.would_do for fit in sizing.fits):
        raise typer.Exit(NOT_ACHIEVED)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sizing:
    """Servos compared with the torque of a hinge.

    Attributes:
        torque_wp: Torque of the hinge, w·p.
        pitch_m: Distance between modules, m.
        casing: Material of a module.
        share: Fraction of the stall torque that a servo can hold continuously.
        gravity_m_s2: Gravity, m/s².
        fits: Comparison of each servo with the torque.
        ranges: Pitches at which each servo is suitable.
        reaches: Largest torque of each servo, and the requested shapes that need no more.
    """

    torque_wp: float
    pitch_m: float
    casing: Casing
    share: float
    gravity_m_s2: float
    fits: tuple[Fit, ...]
    ranges: dict[Servo, PitchRange]
    reaches: dict[Servo, LargestShape]

    def row(self, fit: Fit, turned: float | None) -> dict[str, Any]:
        """Return the values of a servo; its folding time if the turned angle is given, rad."""
        seconds = inf if turned is None else fit.servo.shortest_time_s(turned, fit.need_nm)
        pitches, most_wp = self.ranges[fit.servo], self.reaches[fit.servo].torque_wp
        return {
            **fit.as_dict(),
            "most_wp": most_wp if isfinite(most_wp) else None,
            "pitch_m": None
            if pitches.empty
            else [pitches.least_m, pitches.most_m if isfinite(pitches.most_m) else None],
            "least_s": seconds if isfinite(seconds) else None,
        }

    def suitable(self, shape: str) -> list[str]:
        """Return the names of the servos that can fold a shape, lightest first."""
        return [
            fit.servo.name
            for fit in sorted(self.fits, key=lambda fit: fit.servos_kg)
            if fit.has_room
            and fit.servo.turns_enough is not False
            and shape in self.reaches[fit.servo].within
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return the conditions as plain JSON values."""
        return {
            "torque_wp": self.torque_wp,
            "pitch_m": self.pitch_m,
            "material": self.casing.about,
            "share": self.share,
            "gravity_m_s2": self.gravity_m_s2,
        }


def _casing(material: str, mass_g: float | None, pitch_m: float) -> Casing:
    """Return the casing of a material, or one that makes modules weigh a mass."""
    return casing_named(material) if mass_g is None else Casing.weighing(1e-3 * mass_g, pitch_m)


def _sized(
    torque_wp: float,
    pitch_m: float,
    casing: Casing,
    share: float,
    gravity_m_s2: float,
    among: tuple[Servo, ...],
    figures: dict[str, float],
) -> _Sizing:
    """Compare servos with a torque, and with the torques of the requested shapes."""
    size: dict[str, Any] = {"casing": casing, "share": share, "gravity_m_s2": gravity_m_s2}
    return _Sizing(
        torque_wp=torque_wp,
        pitch_m=pitch_m,
        fits=find_suitable_servos(torque_wp, pitch_m=pitch_m, among=among, **size),
        ranges={servo: suitable_pitches(servo, torque_wp, **size) for servo in among},
        reaches={servo: largest_shape(servo, figures, pitch_m=pitch_m, **size) for servo in among},
        **size,
    )


def _figures(entries: list[str]) -> dict[str, float]:
    """Return torques by the names of shapes.

    Raises:
        InputError: If a shape is invalid; its code is ``bad-shape``.
    """
    figures: dict[str, float] = {}
    for entry in entries:
        name, _, number = entry.rpartition("=")
        try:
            figures[name] = float(number)
        except ValueError:
            name = ""
        if not name:
            raise InputError("bad-shape", f"got {entry!r}, expected NAME=TORQUE.", where="shape")
    return figures


def _show(
    sizing: _Sizing,
    rows: list[dict[str, Any]],
    figures: dict[str, float],
    suitable: dict[str, list[str]],
) -> None:
    fits = sizing.fits
    share = f"continuous torque = {sizing.share:.2g} × stall torque"
    title = f"Pitch {1e3 * sizing.pitch_m:g} mm, {sizing.casing.about}, {share}"
    console = Console(highlight=False)
    timed = any(row["least_s"] is not None for row in rows)
    grid = Table(title=title, title_justify="left", box=None, pad_edge=False)
    headings = ("Servo", "Module,\ng", "Needs,\nN·m", "Gives,\nN·m", "Gives,\nw·p", "Pitch,\nmm")
    for heading in headings:
        grid.add_column(heading, justify="left" if heading == "Servo" else "right", no_wrap=True)
    if timed:
        grid.add_column("Folding\ntime, s", justify="right", no_wrap=True)
    grid.add_column("Suitable,\ngives ÷ needs")
    for fit, row in zip(fits, rows, strict=True):
        cells = [
            f"{fit.servo.maker} {fit.servo.name}",
            f"{1e3 * fit.module_kg:.3g}",
            f"{fit.need_nm:.2g}",
            f"{fit.gives_nm:.2g}",
            "any" if row["most_wp"] is None else f"{row['most_wp']:.3g}",
            _pitches(row["pitch_m"]),
        ]
        if timed:
            cells.append("–" if row["least_s"] is None else f"{row['least_s']:.2g}")
        unsaid = "" if fit.servo.turns_enough else " ?"
        answer = f"yes, {fit.margin:.1f}×{unsaid}" if fit.would_do else ", ".join(fit.against)
        grid.add_row(*cells, answer)
    console.print(grid)
    if any(fit.would_do and not fit.servo.turns_enough for fit in fits):
        console.print(f"? The servo's range is unknown; a hinge needs {MIN_SERVO_RANGE_DEG:g}°.")
    if not figures:
        return
    shapes = Table(box=None, pad_edge=False)
    for heading in ("Shape", "Needs, w·p", "Suitable servos, lightest first"):
        shapes.add_column(heading, justify="right" if "w·p" in heading else "left")
    for name, figure in figures.items():
        shapes.add_row(name, f"{figure:g}", ", ".join(suitable[name]) or "none")
    console.print()
    console.print(shapes)


def _pitches(bounds: list[float | None] | None) -> str:
    """Return a range of pitches in mm."""
    if bounds is None:
        return "none"
    smallest, largest = bounds
    up_to = "any" if largest is None else f"{1e3 * largest:.0f}"
    return f"{1e3 * (smallest or 0.0):.0f} to {up_to}"
