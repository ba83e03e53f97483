"""Formats in which a plan can be exported, in the order in which they are offered.

Each file is made from a plan alone::

    plan = Plan.load(Path("wrench/plan.npz"))
    Path("wrench.urdf").write_bytes(export_named("urdf").write(plan))

A format's own parts are imported when it is written.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Final

from foldback.planner.errors import InputError
from foldback.planner.exports.export import Export, Write, write_json, write_npz
from foldback.planner.storage.file_names import MODEL, PLAN, PLAN_TEXT

if TYPE_CHECKING:
    from foldback.planner.plan.plan import Plan


def _by(module: str, function: str = "write") -> Write:
    def write(plan: Plan) -> bytes:
        return getattr(import_module(f"foldback.planner.exports.{module}"), function)(plan)

    return write


EXPORTS: Final = (
    Export(
        name="json",
        label="Plan",
        hint="JSON: joint angles, poses, certificate",
        media_type="application/json",
        filename=PLAN_TEXT,
        write=write_json,
    ),
    Export(
        name="npz",
        label="Plan",
        hint="NumPy arrays: the same numbers as in JSON",
        media_type="application/octet-stream",
        filename=PLAN,
        write=write_npz,
    ),
    Export(
        name="csv",
        label="Spreadsheet",
        hint="CSV: joint angles in radians; position in metres and orientation of the root module",
        media_type="text/csv; charset=utf-8",
        filename="plan.csv",
        write=_by("csv_rows"),
        moving=True,
    ),
    Export(
        name="steps",
        label="Steps",
        hint="JSON: for each step, the joints that turn, their angles, and the part that is held",
        media_type="application/json",
        filename="steps.json",
        write=_by("steps"),
        moving=True,
        resting=True,
    ),
    Export(
        name="code",
        label="Code",
        hint="Text: the figure of a Rubik's snake or the pieces of a snake cube, in all notations",
        media_type="text/plain; charset=utf-8",
        filename="code.txt",
        write=_by("code_text"),
        coded=True,
    ),
    Export(
        name="leaflet",
        label="Leaflet, A4",
        hint="PDF with drawings of all steps, for folding by hand; readable in black and white",
        media_type="application/pdf",
        filename="leaflet-a4.pdf",
        write=_by("leaflet_pdf"),
        package="reportlab",
        moving=True,
        resting=True,
    ),
    Export(
        name="leaflet-letter",
        label="Leaflet, Letter",
        hint="The same PDF for Letter paper",
        media_type="application/pdf",
        filename="leaflet-letter.pdf",
        write=_by("leaflet_pdf", "write_letter"),
        package="reportlab",
        moving=True,
        resting=True,
    ),
    Export(
        name="leaflet-html",
        label="Leaflet, HTML",
        hint="The same drawings as one HTML file, for screens and printers",
        media_type="text/html; charset=utf-8",
        filename="leaflet.html",
        write=_by("leaflet_html"),
        moving=True,
        resting=True,
    ),
    Export(
        name="mjcf",
        label="Robot model",
        hint="MJCF for MuJoCo, with keyframes of the fold; lengths in pitches",
        media_type="application/xml",
        filename=MODEL,
        write=_by("mjcf"),
    ),
    Export(
        name="urdf",
        label="Robot model",
        hint="URDF for ROS and similar tools, in metres; modules that are no boxes also need "
        "module.obj",
        media_type="application/xml",
        filename="model.urdf",
        write=_by("urdf"),
    ),
    Export(
        name="srdf",
        label="Collision pairs",
        hint="SRDF for MoveIt and similar tools, used with URDF; lists the pairs of linked "
        "modules that collision checks skip",
        media_type="application/xml",
        filename="model.srdf",
        write=_by("srdf"),
    ),
    Export(
        name="mcap",
        label="Robot log",
        hint="MCAP with ROS 2 joint states and one joint trajectory, for Foxglove and rosbag",
        media_type="application/octet-stream",
        filename="joints.mcap",
        write=_by("mcap_log"),
        package="mcap_ros2",
        moving=True,
    ),
    Export(
        name="glb",
        label="Animated scene",
        hint="GLB for Blender, slides and web pages, in metres",
        media_type="model/gltf-binary",
        filename="fold.glb",
        write=_by("glb"),
        moving=True,
    ),
    Export(
        name="stl",
        label="Module",
        hint="STL of one module's outer solid, without its joints; in millimetres",
        media_type="model/stl",
        filename="module.stl",
        write=_by("stl"),
        shared=True,
    ),
    Export(
        name="obj",
        label="Mesh for the URDF",
        hint="OBJ of one module's outer solid, in metres",
        media_type="model/obj",
        filename="module.obj",
        write=_by("obj"),
        shared=True,
    ),
)
"""All file formats in which a plan can be exported, in the order in which they are offered."""


def exports_of(*, moving: bool, resting: bool, coded: bool = False) -> tuple[Export, ...]:
    """Return the exports of a plan whose packages are installed.

    Args:
        moving: True to include those that show its motion.
        resting: True to include those that show its steps.
        coded: True to include those of snakes and snake cubes.
    """
    return tuple(
        export
        for export in EXPORTS
        if export.is_available
        and (moving or not export.moving)
        and (resting or not export.resting)
        and (coded or not export.coded)
    )


def export_named(name: str) -> Export:
    """Return the export of that name.

    Raises:
        InputError: ``unknown-export`` when there is none, ``missing-package`` when the package that
            it needs is not installed.
    """
    for export in EXPORTS:
        if export.name == name and not export.is_available:
            raise InputError(
                "missing-package",
                f"the export format {name} needs a package that is not installed; install it with "
                "pip install 'foldback[exports]'.",
            )
        if export.name == name:
            return export
    known_names = ", ".join(export.name for export in EXPORTS)
    raise InputError(
        "unknown-export", f"got the export format {name[:40]!r}, expected one of: {known_names}."
    )
