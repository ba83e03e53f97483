"""``foldback retime``: a plan with the time stamps that a robot can follow."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from cli.inputs import read_plan, refuse
from cli.options import AsJson, FoldDirectory
from planner.certificate.figures import CertificateFigures
from planner.chain.statics import GRAVITY_M_S2
from planner.clearance.sweep import Sweep
from planner.errors import InputError
from planner.exports.trajectory import (
    MAX_TOUCH_DEPTH_PITCH,
    clearance,
    deviation,
    export,
    sufficient_rate,
)
from planner.files import write_whole
from planner.robot.motors import Build, MotorTable, motor_table
from planner.robot.retiming import retime as retime_plan
from words import certificate as certificate_words

MAX_LISTED_JOINTS = 10
"""Maximum number of joints in the printed table of motor torques: those with the largest peak
torques. A larger value makes the table longer. Chosen."""


def retime(
    *,
    directory: FoldDirectory,
    max_speed: Annotated[float, typer.Option(help="Maximum joint speed, rad/s.")],
    max_acceleration: Annotated[float, typer.Option(help="Maximum joint acceleration, rad/s².")],
    out: Annotated[Path, typer.Option(help="Output file, .csv or .json.")],
    rate: Annotated[
        float | None, typer.Option(help="Rows per second. Default: one row per frame of the plan.")
    ] = None,
    check: Annotated[bool, typer.Option(help="Check the trajectory for collisions again.")] = True,
    module_mass: Annotated[
        float | None, typer.Option(help="Mass of a module, kg; also computes torques.")
    ] = None,
    pitch: Annotated[
        float | None, typer.Option(help="Distance between modules, m. Default: the plan's pitch.")
    ] = None,
    gravity: Annotated[float, typer.Option(help="Gravity in m/s², 0 for none.")] = GRAVITY_M_S2,
    floating: Annotated[
        bool, typer.Option("--floating", help="Let the chain float; otherwise its root is held.")
    ] = False,
    motor_torque: Annotated[
        float | None,
        typer.Option(help="Torque of a motor, N·m. Checks if the motor is strong enough."),
    ] = None,
    table: Annotated[
        Path | None, typer.Option(help="Output file for the torques of all joints, .csv.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Add time stamps to a plan within a robot's limits. Exits with 3 if it is unsuitable."""
    try:
        form = _form(out)
        if module_mass is None and (motor_torque is not None or table is not None):
            raise InputError("no-mass", "torques need the mass of a module: --module-mass KG.")
        plan = read_plan(directory)
        trajectory = retime_plan(plan, max_speed, max_acceleration)
        size = plan.certificate.module_size
        clear = clearance(trajectory, plan.chain, size=size, rate_hz=rate) if check else None
        enough = None
        if clear is not None and clear.bound <= 0.0 and rate is not None and plan.verified:
            enough = sufficient_rate(trajectory, plan.chain, size=size, rate_hz=rate)
        parts = export(
            trajectory,
            form,
            name=plan.chain.name,
            plan_verified=plan.verified,
            clear=None if clear is None else (clear.clearance, clear.bound),
            rate_hz=rate,
        )
        motors = None
        if module_mass is not None:
            build = Build(
                module_mass_kg=module_mass,
                pitch_m=plan.chain.pitch_m if pitch is None else pitch,
                gravity_m_s2=gravity,
                held=not floating,
            )
            motors = motor_table(plan.chain, trajectory, build, motor_torque_nm=motor_torque)
        _write(out, parts)
        if table is not None and motors is not None:
            _write(table, [motors.as_csv().encode()])
    except InputError as error:
        refuse(error, as_json)
    report: dict[str, Any] = {
        "duration_s": trajectory.duration_s,
        "deviation_rad": deviation(trajectory, rate),
        "min_clearance": clear and clear.clearance,
        "clearance_bound": clear and clear.bound,
        "sufficient_rate_hz": enough,
        "plan_verified": plan.verified,
        "motors": None if motors is None else motors.as_dict(),
    }
    if as_json:
        print(json.dumps(report), flush=True)
    else:
        facts = [
            ("Plan", certificate_words.headline(plan.certificate.as_dict())),
            ("Duration", f"{trajectory.duration_s:.3g} s"),
            ("Deviation from the plan", f"{deviation(trajectory, rate):.2g} rad at most"),
        ]
        if clear is not None:
            facts.append(("Between rows", _clearance_words(clear, enough)))
        _show(facts, motors, out)
    weak = motors is not None and motors.would_do is False
    # Nothing that cannot be proved clear would do, as of a plan.
    if weak or not plan.verified or (clear is not None and clear.bound <= 0.0):
        raise typer.Exit(3)


def _form(out: Path) -> Any:
    form = out.suffix.removeprefix(".")
    if form not in ("csv", "json"):
        raise InputError(
            "unknown-form", f"got {out.name!r}, expected a name that ends in .csv or .json."
        )
    return form


def _write(path: Path, parts: Iterable[bytes]) -> None:
    try:
        write_whole(path, b"".join(parts))
    except OSError as error:
        raise InputError(
            "no-file", f"cannot be written ({error.strerror}).", where=str(path)
        ) from error


def _clearance_words(clear: Sweep, sufficient_hz: float | None) -> str:
    """Return what holds for the lines of the file, joined by straight motions of all joints."""
    if clear.bound > 0.0:
        figures: CertificateFigures = {
            "clearance_bound": clear.bound,
            "min_clearance": clear.clearance,
        }
        return certificate_words.clearance(figures) or ""
    words = (
        f"modules overlap by {-clear.clearance:.2g} pitch"
        if clear.clearance < -MAX_TOUCH_DEPTH_PITCH
        else f"clearance not proved; smallest measured {max(0.0, clear.clearance):.2g} pitch"
    )
    return words if sufficient_hz is None else f"{words}; --rate {sufficient_hz:g} is enough"


def _show(facts: list[tuple[str, str]], motors: MotorTable | None, out: Path) -> None:
    console = Console(highlight=False)
    table = Table(box=None, show_header=False, pad_edge=False)
    for fact in facts:
        table.add_row(*fact)
    if motors is not None:
        table.add_row("Motors", motors.verdict)
    table.add_row("Written to", str(out))
    console.print(table)
    if motors is None:
        return
    columns = Table(box=None, pad_edge=False)
    for heading in ("Joint", "Peak, N·m", "at frame", "RMS, N·m"):
        columns.add_column(heading, justify="left" if heading == "Joint" else "right")
    for k in np.argsort(-motors.peak_torque_nm)[:MAX_LISTED_JOINTS]:
        columns.add_row(
            motors.joint_names[k],
            f"{motors.peak_torque_nm[k]:.3g}",
            f"{motors.peak_frame[k]:.0f}",
            f"{motors.rms_torque_nm[k]:.3g}",
        )
    console.print(columns)
