"""``foldback table``: check that a plan is stable on a table; compute its joint torques."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from foldback.cli.exit_statuses import NOT_ACHIEVED
from foldback.cli.inputs import read_plan, refuse
from foldback.cli.options import AsJson
from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.certificate.table_figures import TableCertificate
from foldback.planner.errors import InputError
from foldback.planner.parameters.explosion import Base
from foldback.planner.plan.plan import Plan
from foldback.planner.storage.file_names import PLAN, TABLE_FILE
from foldback.planner.storage.files import write_whole
from foldback.words.messages import reason_text


def table(
    *,
    plan: Annotated[
        Path,
        typer.Argument(metavar="PLAN", help=("Folder written by `foldback fold`, or a plan file.")),
    ],
    friction: Annotated[
        float, typer.Option(help="Coefficient of friction between modules and table.")
    ] = 0.0,
    base: Annotated[
        str, typer.Option(help="Base: clamped (first module fixed to the table) or free.")
    ] = "clamped",
    module_kg: Annotated[
        float | None,
        typer.Option(
            help="Mass of a module, kg. Default: the mass of a solid module with the plan's "
            "density."
        ),
    ] = None,
    pitch_mm: Annotated[
        float | None, typer.Option(help="Distance between modules, mm. Default: the plan's pitch.")
    ] = None,
    bound: Annotated[
        float | None,
        typer.Option(help="Torque limit in w·p (module weight × pitch)."),
    ] = None,
    module_size: Annotated[
        float, typer.Option(help="Module size as a fraction of the pitch.")
    ] = 1.0,
    out: Annotated[
        Path | None, typer.Option(help=f"Output file. Default: {TABLE_FILE} beside the plan.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Check whether a plan works on a table, and compute the joint torques.

    Exits with 3 if the chain does not stay on the table.
    """
    try:
        path = _file(plan)
        loaded = read_plan(plan) if plan.is_dir() else Plan.load(path)
        on_table = loaded.parameters.get("world") == "table"
        certificate = table_certificate(
            loaded.chain,
            loaded.motion,
            friction=friction,
            base=_base(base),
            module_kg=module_kg,
            pitch_m=None if pitch_mm is None else pitch_mm / 1000.0,
            density_kg_m3=float(loaded.parameters["density_kg_m3"]),
            module_size=module_size,
            bound=bound,
            height=loaded.chain.table_height if on_table else 0.0,
        )
        written = out or _beside(path)
        _write(written, certificate)
    except InputError as error:
        refuse(error, as_json)
    if as_json:
        print(json.dumps(certificate.as_dict()), flush=True)
    else:
        _show(certificate, written)
    if not certificate.rests:
        raise typer.Exit(NOT_ACHIEVED)


def _file(plan: Path) -> Path:
    path = plan / PLAN if plan.is_dir() else plan
    if not path.is_file():
        raise InputError(
            "no-plan",
            "got no plan, expected a folder that `foldback fold` wrote, or its plan.json or "
            "plan.npz.",
            where=str(plan),
        )
    return path


def _base(base: str) -> Base:
    if base == "clamped" or base == "free":
        return base
    raise InputError("bad-table", f"got the base {base!r}, expected clamped or free.", where="base")


def _beside(path: Path) -> Path:
    return path.with_name(TABLE_FILE if path.stem == "plan" else f"{path.stem}.{TABLE_FILE}")


def _write(path: Path, certificate: TableCertificate) -> None:
    try:
        write_whole(path, json.dumps(certificate.as_dict()).encode())
    except OSError as error:
        raise InputError(
            "no-file", f"cannot be written ({error.strerror}).", where=str(path)
        ) from error


def _show(certificate: TableCertificate, written: Path) -> None:
    console = Console(highlight=False)
    base_text = certificate.base_text
    facts = Table(box=None, show_header=False, pad_edge=False)
    verdict = (
        "stays on the table" if certificate.reason is None else reason_text(certificate.reason)
    )
    facts.add_row("Verdict", verdict)
    if certificate.torque is not None and certificate.torque_nm is not None:
        at = "" if certificate.frame is None else f", in frame {certificate.frame + 1}"
        facts.add_row("Largest torque", f"{certificate.torque:.3g} w·p, {base_text}{at}")
        facts.add_row("", f"{certificate.torque_nm:.3g} N·m, {base_text}")
    facts.add_row(
        "1 w·p",
        f"{certificate.unit_nm:.3g} N·m: modules of {certificate.module_kg:.3g} kg, "
        f"{certificate.pitch_m * 1000.0:g} mm apart",
    )
    facts.add_row(
        "Base",
        "the first module is clamped to the table"
        if certificate.base == "clamped"
        else "the chain lies on the table and is not clamped",
    )
    standing_counts = [len(standing) for standing in certificate.standing]
    facts.add_row(
        "Modules that touch the table",
        f"{min(standing_counts)} to {max(standing_counts)} of {certificate.modules}",
    )
    if certificate.on_table:
        facts.add_row(
            "Lowest corner",
            f"{certificate.clearance:+.3f} pitch above the table, "
            f"in frame {certificate.clearance_frame + 1}",
        )
    tips = len(certificate.unbalanced)
    facts.add_row(
        "Frames", f"{len(certificate.torques)}; the chain would tip over in {tips} of them"
    )
    facts.add_row("Written to", str(written))
    console.print(facts)
    for line in certificate.assumptions:
        console.print(f"assumed: {line}", markup=False)
