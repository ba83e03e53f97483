"""``foldback retime``: write a plan with time stamps that a robot can follow."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import read_plan, refuse
from foldback.cli.options import AsJson, FoldDirectory
from foldback.planner.certificate.figures import CertificateFigures
from foldback.planner.chain.cantilever_statics import GRAVITY_M_S2
from foldback.planner.clearance.sweep import Sweep
from foldback.planner.errors import InputError
from foldback.planner.exports.trajectory import (
    MAX_TOUCH_DEPTH_PITCH,
    clearance,
    deviation,
    export,
    sufficient_rate,
)
from foldback.planner.plan.plan import Plan
from foldback.planner.storage.files import written_aside
from foldback.planner.trajectories.motors import Build, MotorRequirements, motor_requirements
from foldback.planner.trajectories.retiming import retime as retime_plan
from foldback.planner.trajectories.trajectory import Trajectory
from foldback.words import certificate as certificate_words
from foldback.words.messages import PEOPLE, nearest_frame
from foldback.words.quantities import spacings


def retime(
    *,
    directory: FoldDirectory,
    max_acceleration: Annotated[float, typer.Option(help="Maximum joint acceleration, rad/s².")],
    out: Annotated[Path, typer.Option(help="Output file, .csv or .json.")],
    max_speed: Annotated[
        float | None,
        typer.Option(help="Maximum joint speed, rad/s. Default: that of the module, if known."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(help="Rows per second in the output file. Default: one row per frame."),
    ] = None,
    check: Annotated[bool, typer.Option(help="Check the trajectory for collisions again.")] = True,
    module_mass: Annotated[
        float | None,
        typer.Option(
            help="Mass of a module, kg. If it is known, torques are computed as well. Default: "
            "that of the module, if known."
        ),
    ] = None,
    pitch: Annotated[
        float | None, typer.Option(help="Distance between modules, m. Default: the plan's pitch.")
    ] = None,
    gravity: Annotated[float, typer.Option(help="Gravity in m/s², 0 for none.")] = GRAVITY_M_S2,
    floating: Annotated[
        bool,
        typer.Option("--floating", help="Let the chain float. Default: its middle module is held."),
    ] = False,
    motor_torque: Annotated[
        float | None,
        typer.Option(
            help="Motor torque, N·m. If it is known, foldback checks whether the motors are strong "
            "enough. Default: that of the module, if known."
        ),
    ] = None,
    table: Annotated[
        Path | None, typer.Option(help="Output file for the torques of all joints, .csv.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Add time stamps to a plan so that it keeps to a robot's limits.

    Exits with 3 if a check fails.
    """
    try:
        form = _form(out)
        plan = read_plan(directory)
        module = plan.chain.module
        speed = _known(max_speed, module.speed_rad_s)
        if speed is None:
            raise InputError("no-speed", "this module has no known speed; add --max-speed RAD/S.")
        module_mass = _known(module_mass, module.mass_kg)
        if module_mass is None and (motor_torque is not None or table is not None):
            raise InputError("no-mass", "torques cannot be computed without --module-mass KG.")
        motor_torque = _known(motor_torque, module.torque_nm)
        retimed = _retimed(plan, retime_plan(plan, speed, max_acceleration), rate, check=check)
        parts = retimed.export(form)
        build = _build(plan, module_mass, pitch, gravity, floating=floating)
        motors = None
        if build is not None:
            motors = motor_requirements(
                plan.chain, retimed.trajectory, build, motor_torque_nm=motor_torque
            )
        files = {out: b"".join(parts)}
        if table is not None and motors is not None:
            files[table] = motors.as_csv().encode()
        _write(files)
    except InputError as error:
        refuse(error, as_json)
    if as_json:
        report = {**retimed.as_dict(), "motors": None if motors is None else motors.as_dict()}
        print(json.dumps(report), flush=True)
    else:
        _show(retimed.facts(), motors, out)
    if not retimed.is_clear or (motors is not None and motors.would_do is False):
        raise typer.Exit(NOT_ACHIEVED)


def _known(given: float | None, of_module: float | None) -> float | None:
    """Return what is given, or else what is known of the module."""
    return of_module if given is None else given


@dataclass(frozen=True, slots=True, kw_only=True)
class _Retimed:
    """Retimed plan.

    Attributes:
        plan: The plan.
        trajectory: Its path with times.
        rate_hz: Number of rows per second; None for one row per frame of the plan.
        clear: Clearance of the rows, joined by straight motions; None if it was not checked.
        sufficient_hz: Rows per second that are enough to be clear, if these are not.
    """

    plan: Plan
    trajectory: Trajectory
    rate_hz: float | None
    clear: Sweep | None
    sufficient_hz: float | None

    @property
    def is_clear(self) -> bool:
        """True if the plan is verified and the rows are proved to be clear, or were not checked."""
        return self.plan.verified and (self.clear is None or self.clear.bound > 0.0)

    def export(self, form: Any) -> Iterable[bytes]:
        """Return the content of the output file."""
        clear = self.clear
        return export(
            self.trajectory,
            form,
            name=self.plan.chain.name,
            plan_verified=self.plan.verified,
            clear=None if clear is None else (clear.clearance, clear.bound),
            rate_hz=self.rate_hz,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values."""
        return {
            "duration_s": self.trajectory.duration_s,
            "deviation_rad": deviation(self.trajectory, self.rate_hz),
            "min_clearance": self.clear and self.clear.clearance,
            "clearance_bound": self.clear and self.clear.bound,
            "sufficient_rate_hz": self.sufficient_hz,
            "plan_verified": self.plan.verified,
        }

    def facts(self) -> list[tuple[str, str]]:
        """Return the names and values that are printed."""
        off_rad = deviation(self.trajectory, self.rate_hz)
        facts = [
            ("Plan", certificate_words.headline(self.plan.certificate.as_dict())),
            ("Duration", f"{self.trajectory.duration_s:.3g} s"),
            ("Deviation from the plan", f"at most {off_rad:.2g} rad"),
        ]
        if self.clear is not None:
            facts.append(
                ("Clearance between rows", _clearance_words(self.clear, self.sufficient_hz))
            )
        return facts


def _retimed(plan: Plan, trajectory: Trajectory, rate: float | None, *, check: bool) -> _Retimed:
    """Check the clearance of a trajectory, and find a sufficient rate if it is not clear."""
    size = plan.certificate.module_size
    clear = clearance(trajectory, plan.chain, module_size=size, rate_hz=rate) if check else None
    enough = None
    if clear is not None and clear.bound <= 0.0 and rate is not None and plan.verified:
        enough = sufficient_rate(trajectory, plan.chain, module_size=size, rate_hz=rate)
    return _Retimed(
        plan=plan, trajectory=trajectory, rate_hz=rate, clear=clear, sufficient_hz=enough
    )


def _build(
    plan: Plan, module_mass: float | None, pitch: float | None, gravity: float, *, floating: bool
) -> Build | None:
    """Return masses, lengths and support of the chain; None without a mass."""
    if module_mass is None:
        return None
    return Build(
        module_mass_kg=module_mass,
        pitch_m=plan.chain.pitch_m if pitch is None else pitch,
        gravity_m_s2=gravity,
        held=not floating,
    )


def _form(out: Path) -> Any:
    form = out.suffix.removeprefix(".")
    if form not in ("csv", "json"):
        raise InputError(
            "unknown-form", f"got {out.name!r}, expected a name that ends in .csv or .json."
        )
    return form


def _write(files: Mapping[Path, bytes]) -> None:
    """Write files that belong together: if this is interrupted, the first one is missing.

    Raises:
        InputError: ``no-file``.
    """
    first, *_ = files
    path = first
    try:
        with ExitStack() as written:
            for path, data in files.items():
                written.enter_context(written_aside(path)).write_bytes(data)
            if len(files) > 1:
                first.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            "no-file", f"cannot be written ({error.strerror}).", where=str(path)
        ) from error


def _clearance_words(clear: Sweep, sufficient_hz: float | None) -> str:
    """Return a statement on the clearance of the file's lines, joined by straight joint motions."""
    if clear.bound > 0.0:
        figures: CertificateFigures = {
            "clearance_bound": clear.bound,
            "min_clearance": clear.clearance,
        }
        return certificate_words.clearance(figures) or ""
    words = (
        f"modules overlap by {spacings(-clear.clearance, 2)}"
        if clear.clearance < -MAX_TOUCH_DEPTH_PITCH
        else "clearance not proved; the smallest measured gap between modules is "
        f"{spacings(max(0.0, clear.clearance), 2)}"
    )
    return words if sufficient_hz is None else f"{words}; use --rate {sufficient_hz:g}"


def _show(facts: list[tuple[str, str]], motors: MotorRequirements | None, out: Path) -> None:
    console = Console(highlight=False)
    table = Table(box=None, show_header=False, pad_edge=False)
    for fact in facts:
        table.add_row(*fact)
    if motors is not None:
        table.add_row("Motors", motors.text(PEOPLE))
    table.add_row("Written to", str(out))
    console.print(table)
    if motors is None:
        return
    columns = Table(box=None, pad_edge=False)
    for heading in ("Joint", "Peak, N·m", "Peak at frame", "Root mean square, N·m"):
        columns.add_column(heading, justify="left" if heading == "Joint" else "right")
    for k in np.argsort(-motors.peak_torque_nm)[:10]:
        columns.add_row(
            motors.joint_names[k],
            f"{motors.peak_torque_nm[k]:.3g}",
            str(nearest_frame(float(motors.peak_frame[k])) + 1),
            f"{motors.rms_torque_nm[k]:.3g}",
        )
    console.print(columns)
