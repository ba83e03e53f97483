"""``foldback servos``: which motors would do for a torque, and at which size of modules."""

from __future__ import annotations

import json
from math import inf, isfinite
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from cli.inputs import read_plan, refuse
from cli.options import AsJson
from planner.chain.statics import GRAVITY_M_S2
from planner.errors import InputError
from planner.robot.casings import CASINGS, Casing, casing_named
from planner.robot.servos import MIN_SERVO_RANGE_DEG, servo_named
from planner.robot.servos import servos as all_servos
from planner.robot.sizing import (
    PERMANENT_TORQUE_SHARE,
    Fit,
    PitchRange,
    at_which_pitch,
    largest_shape,
    turned_rad,
    who_would_do,
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
            help="Also list servos for a shape that needs this torque; repeatable.",
        ),
    ] = None,
    plan: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Also show the shortest folding time of this fold."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """List servos that are strong enough for a torque. Exits with 3 if there are none."""
    try:
        pitch_m = 1e-3 * pitch_mm
        casing = (
            casing_named(material) if mass_g is None else Casing.weighing(1e-3 * mass_g, pitch_m)
        )
        among = all_servos() if only is None else (servo_named(only),)
        size: dict[str, Any] = {"casing": casing, "share": share, "gravity_m_s2": gravity}
        fits = who_would_do(torque, pitch_m=pitch_m, among=among, **size)
        ranges = {fit.servo: at_which_pitch(fit.servo, torque, **size) for fit in fits}
        wanted = _figures(shapes or [])
        reaches = {
            fit.servo: largest_shape(fit.servo, wanted, pitch_m=pitch_m, **size) for fit in fits
        }
        turned = None if plan is None else turned_rad(read_plan(plan).joint_angles_rad)
    except InputError as error:
        refuse(error, as_json)
    rows = [_row(fit, ranges[fit.servo], reaches[fit.servo].torque_wp, turned) for fit in fits]
    serve = {
        name: [
            fit.servo.name
            for fit in sorted(fits, key=lambda fit: fit.servos_kg)
            if fit.has_room
            and fit.servo.turns_enough is not False
            and name in reaches[fit.servo].within
        ]
        for name in wanted
    }
    if as_json:
        told = {
            "torque_wp": torque,
            "pitch_m": pitch_m,
            "material": casing.about,
            "share": share,
            "gravity_m_s2": gravity,
            "servos": rows,
            "shapes": serve,
        }
        print(json.dumps(told), flush=True)
    else:
        _show(fits, rows, wanted, serve, f"{pitch_mm:g} mm, {casing.about}; {share:.2g} of stall")
    if not any(fit.would_do for fit in fits):
        raise typer.Exit(3)


def _figures(given: list[str]) -> dict[str, float]:
    """Torques by the names of shapes.

    Raises:
        InputError: ``bad-shape``.
    """
    figures: dict[str, float] = {}
    for each in given:
        name, _, number = each.rpartition("=")
        try:
            figures[name] = float(number)
        except ValueError:
            name = ""
        if not name:
            raise InputError("bad-shape", f"got {each!r}, expected NAME=TORQUE.", where="shape")
    return figures


def _row(fit: Fit, pitches: PitchRange, most_wp: float, turned: float | None) -> dict[str, Any]:
    servo = fit.servo
    seconds = inf if turned is None else servo.shortest_time_s(turned, fit.need_nm)
    return {
        **fit.as_dict(),
        "most_wp": most_wp if isfinite(most_wp) else None,
        "pitch_m": None
        if pitches.empty
        else [pitches.least_m, pitches.most_m if isfinite(pitches.most_m) else None],
        "least_s": seconds if isfinite(seconds) else None,
    }


def _show(
    fits: tuple[Fit, ...],
    rows: list[dict[str, Any]],
    wanted: dict[str, float],
    serve: dict[str, list[str]],
    title: str,
) -> None:
    console = Console(highlight=False)
    timed = any(row["least_s"] is not None for row in rows)
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for heading in ("Servo", "Module\ng", "Needs\nN·m", "Gives\nN·m", "Up to\nw·p", "Pitch\nmm"):
        table.add_column(heading, justify="left" if heading == "Servo" else "right", no_wrap=True)
    if timed:
        table.add_column("Folds\nin s", justify="right", no_wrap=True)
    table.add_column("Suitable")
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
        table.add_row(*cells, answer)
    console.print(table)
    if any(fit.would_do and not fit.servo.turns_enough for fit in fits):
        console.print(f"? The servo's range is unknown; a hinge needs {MIN_SERVO_RANGE_DEG:g}°.")
    if not wanted:
        return
    shapes = Table(box=None, pad_edge=False)
    for heading in ("Shape", "Needs, w·p", "Suitable servos, lightest first"):
        shapes.add_column(heading, justify="right" if "w·p" in heading else "left")
    for name, figure in wanted.items():
        shapes.add_row(name, f"{figure:g}", ", ".join(serve[name]) or "none")
    console.print()
    console.print(shapes)


def _pitches(bounds: list[float | None] | None) -> str:
    """Return a range of pitches in mm."""
    if bounds is None:
        return "none"
    least, most = bounds
    up_to = "any" if most is None else f"{1e3 * most:.0f}"
    return f"{1e3 * (least or 0.0):.0f} to {up_to}"
