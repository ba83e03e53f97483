"""Schemas: JSON bodies of the API. The request of a fold is in ``planner.pipeline.request``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler
from pydantic_core import CoreSchema

from foldback.planner.chain.module import ModuleWords
from foldback.planner.exports.export import Export
from foldback.planner.parameters.parameters import World
from foldback.planner.pathfinding import PATH_METHODS
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.progress import Stage
from foldback.planner.readers.gallery import GalleryShape
from foldback.server.jobs.eta import EtaEstimator
from foldback.server.store.estimates import Expected, plain_fold
from foldback.server.store.folds import FoldRow, Store
from foldback.server.store.schema import REQUESTED_COLUMNS
from foldback.words.fold import ShownFold

SMOOTHING_MESSAGE: Final = "smoothing"
"""Progress message of the stage ``explode`` if a fold only smooths an existing plan; web pages name
the stage by this text."""
PAUSED_MESSAGE: Final = "Paused to let other folds run. It continues automatically."
Status = Literal["queued", "running", "verified", "failed", "cancelled"]
MAX_FOLD_NAME: Final = 200
"""Maximum length of the name that an owner gives a fold, in characters; a longer one is refused."""
SHOWN_COLUMNS: Final = (
    *("id", "name", "status", "stage", "public", "modules", "module", "shape", "refold", "smooths"),
    *REQUESTED_COLUMNS,
)
"""Columns of a fold's row that the API shows as they are, under the same names."""


class Body(BaseModel):
    """JSON object of the API; docstrings of its attributes are their descriptions."""

    model_config = ConfigDict(use_attribute_docstrings=True)

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        resolved = handler(core_schema)
        for property_schema in handler.resolve_ref_schema(resolved).get("properties", {}).values():
            if "description" in property_schema:
                property_schema["description"] = " ".join(property_schema["description"].split())
        return resolved


class ProblemBody(Body):
    """A problem in the format of RFC 9457."""

    type: str
    title: str
    status: int
    code: str
    """Short name of the problem, for programs; it never changes."""
    values: dict[str, Any]
    """Values that the detail names; numbers of modules, cells and angles count from 0."""
    detail: str
    """Description of the problem: the given value, the expected one, and the remedy."""
    message: str
    """The detail and its position for people: modules, cells and angles count from 1."""
    where: str | None
    """Position in the input, if the problem has one."""


class Links(Body):
    """Links to the parts of a fold."""

    self: str
    page: str
    drawing: str
    events: str
    frames: str
    cancel: str
    refolds: str
    plan_json: str
    plan_npz: str
    model: str
    exports: str

    @classmethod
    def of(cls, fold_id: str) -> Links:
        """Return the links of a fold."""
        fold_path = f"/api/folds/{fold_id}"
        return cls(
            self=fold_path,
            page=f"/folds/{fold_id}",
            drawing=f"/folds/{fold_id}/drawing.svg",
            events=f"{fold_path}/events",
            frames=f"{fold_path}/frames",
            cancel=f"{fold_path}/cancel",
            refolds=f"{fold_path}/refolds",
            plan_json=f"{fold_path}/plan.json",
            plan_npz=f"{fold_path}/plan.npz",
            model=f"{fold_path}/model.xml",
            exports=f"{fold_path}/exports",
        )


class ExportBody(Body):
    """A file that a finished fold can be downloaded as."""

    name: str
    label: str
    hint: str
    media_type: str
    filename: str
    href: str

    @classmethod
    def of(cls, fold_id: str, export: Export) -> ExportBody:
        """Return the API's representation of an export."""
        values = {name: getattr(export, name) for name in cls.model_fields if name != "href"}
        return cls(**values, href=export_href(fold_id, export))


class ExportList(Body):
    """All files that a finished fold can be downloaded as."""

    exports: list[ExportBody]


def export_href(fold_id: str, export: Export) -> str:
    """Return the address of an export."""
    return f"/api/folds/{fold_id}/exports/{export.name}"


class Accepted(Body):
    """An accepted fold."""

    id: str
    owner_token: str | None
    """Owner token, required to cancel or delete: the token you sent, or a new one. Null for a
    gallery fold or another client's fold, which you can only view."""
    existing: bool
    """True if the same request was made before; the fold is then the earlier one."""
    links: Links


class Progress(Body):
    """Progress of a fold; the data of the event ``progress``."""

    status: Status
    stage: Stage | None
    fraction: float
    """Progress of the stage, 0 to 1."""
    steps: int
    steps_per_second: float
    simulated_s: float
    """Simulated time of the stage, s; 0 if unknown."""
    message: str
    plan: int
    """Number of the current plan, counted from 1; 0 if plans are not counted."""
    plans: int
    """Estimated number of plans in all, for a fold with a preference; 0 if unknown."""
    modules: int
    queue_position: int
    """Position in the queue: 1 is next, 0 means that the fold is not waiting."""
    running_before: int
    """Number of running folds that a queued fold waits for; 0 if it does not wait."""
    paused: bool
    """Paused to let other folds run; it continues automatically."""
    frames: int
    """Number of frames available so far."""
    busy: bool
    """True while the fold waits for a processor much of the time, because the computer has other
    work."""
    wait_s: float | None
    """Estimated waiting time, s; null if the fold is not waiting or no worker runs."""
    remaining_s: int | None
    """Estimated remaining time, s, including the wait, based on similar folds; 0 if this fold takes
    longer than they did; null if unknown or finished."""


class Fault(Body):
    """Reason why a fold has no verified plan."""

    code: str
    values: dict[str, Any] = Field(default_factory=dict[str, Any])
    """Values that the detail names; numbers of modules, cells and angles count from 0."""
    detail: str
    message: str | None = None
    """The detail and its position for people: modules, cells and angles count from 1."""
    where: str | None = None


class ModuleWordsBody(Body):
    """What people call a module."""

    singular: str
    """Of one module, for example `cube`."""
    plural: str
    """Of several, for example `cubes`."""

    @classmethod
    def of(cls, words: ModuleWords) -> ModuleWordsBody:
        """Return the API's representation of words."""
        return cls(singular=words.singular, plural=words.plural)


class Fold(Body):
    """A fold."""

    id: str
    name: str
    """Name from the input or from the owner."""
    title: str
    """Title shown on pages."""
    status: Status
    stage: Stage | None
    created_at: datetime
    expires_at: datetime | None
    """Expiry time if the fold is not viewed again; null if it does not expire or has not
    finished."""
    public: bool
    """True for a gallery fold, which everyone can see."""
    modules: int
    module: str
    """Name of the module."""
    module_words: ModuleWordsBody
    shape: str | None
    """Gallery shape of the fold, if any."""
    refold: str | None
    """Shape in which the chain of a refold starts; null if it starts straight."""
    smooths: str | None
    """Id of the fold whose plan was smoothed; null if this is no smoothed fold."""
    preset: str
    settings: str
    """Settings that differ from the preset's, for example `damping=0.05,step_s=0.005`."""
    seed: int
    module_size: float | None
    strategy: str
    """Strategy; `auto` chooses turns or an explosion by size and path."""
    prefer: str
    """Goal of the choice among verified plans; `computing` takes the first one."""
    world: str
    """World: `floating` without gravity, or on a `table`."""
    progress: Progress
    summary: dict[str, Any]
    """Figures of the plan; empty until the fold is over. If the fold failed, `stuck` gives the
    reason and the modules, if known, with `evidence` that can be checked."""
    error: Fault | None
    links: Links

    @classmethod
    def of(cls, row: FoldRow, store: Store, remaining: EtaEstimator) -> Fold:
        """Return the API's representation of a row."""
        values: dict[str, Any] = {name: getattr(row, name) for name in SHOWN_COLUMNS}
        until, shown = store.kept_until(row), ShownFold.of(row)
        return cls(
            **values,
            title=shown.title,
            module_words=ModuleWordsBody.of(shown.words),
            created_at=moment(row.created_at),
            expires_at=None if until is None else moment(until),
            progress=Progress.model_validate(progress_of(row, remaining)),
            summary=row.summary,
            error=Fault.model_validate(row.error) if row.error else None,
            links=Links.of(row.id),
        )


class Folds(Body):
    """A list of folds, newest first."""

    folds: list[Fold]


class KeyReplaced(Body):
    """The new token, and the number of items that moved to it."""

    owner_token: str
    """The new token; no later response contains it."""
    folds: int
    """Number of items moved."""


class OwnedFolds(Body):
    """Folds of one owner, newest first."""

    folds: list[Fold]
    next: str | None
    """Link to the next page; null on the last page."""
    total: int
    """Total number of items."""


class OwnedPreview(Body):
    """A shape that was uploaded and previewed."""

    id: str
    title: str
    module: str
    """Name of the module."""
    module_words: ModuleWordsBody
    modules: int
    created_at: datetime
    expires_at: datetime
    """Expiry time if the preview is not viewed again."""
    page: str
    drawing: str


class OwnedPreviews(Body):
    """Previews, the last viewed one first."""

    previews: list[OwnedPreview]


class Shape(Body):
    """A shape of the gallery."""

    name: str
    title: str
    module: str
    """Name of the module."""
    modules: int
    tags: list[str]
    """Kinds of shape."""

    @classmethod
    def of(cls, shape: GalleryShape) -> Shape:
        """Return the API's representation of an example."""
        return cls.model_validate(shape, from_attributes=True)


class Shapes(Body):
    """The gallery, shortest chain first."""

    shapes: list[Shape]


class Trouble(Body):
    """Problem that prevents a path through the cells."""

    code: str
    values: dict[str, Any]
    """Values that the detail names."""
    detail: str
    cells: list[list[int]]
    """Cells that cause the problem."""


class Repair(Body):
    """Change of cells after which there is a path."""

    detail: str
    add: list[list[int]]
    drop: list[list[int]]
    doubled: bool
    """True if each cell becomes 2×2×2 modules."""
    modules: int
    """Number of modules after the repair; request this number if `doubled`."""


class Feasibility(Body):
    """Result of the check for a path through all cells."""

    feasible: bool | None
    """Null if undecided."""
    problems: list[Trouble]
    repairs: list[Repair]
    """Repairs, smallest first; `repair` applies the first one."""


class Knot(Body):
    """Knot of the folded chain after its ends are connected far away from it."""

    verdict: Literal["unknot", "knotted", "undecided"]
    determinant: int | None


class PlacedMesh(Body):
    """The solid in the cells' coordinates: the centre of a cell has whole coordinates."""

    vertices: list[list[float]]
    faces: list[list[int]]


class PreviewLinks(Body):
    """Links of a preview."""

    page: str
    folds: str
    """POST the id here, as `preview`, with the same options."""


def expected_times(report: Mapping[str, Any], world: World, expected: Expected) -> dict[str, float]:
    """Return the estimated seconds of a fold of a preview's shape, by fields of ``Preview``."""
    modules, plain = int(report["modules"]), FoldRequest(module=str(report["module"]))
    requests = {
        "expected_s": replace(plain, world=world),
        "expected_as_published_s": replace(plain, preset="paper"),
        "expected_preferred_s": replace(plain, prefer="time"),
    }
    return {
        name: expected(plain_fold(modules, request_of_kind))
        for name, request_of_kind in requests.items()
    }


class TunnelCounts(Body):
    """Numbers of holes through a shape, such as that of a ring or a handle."""

    mesh: int
    """In the mesh, or in its largest body if it has several."""
    cells: int


class LikenessBody(Body):
    """Overlap of the modules, which fill their cells, with the whole input."""

    iou: float
    """Intersection over union: volume of the overlap ÷ volume of what either covers, 0 to 1."""
    missing: float
    """Share of the input's volume that no module covers, 0 to 1."""
    added: float
    """Share of the modules' volume outside of the input, 0 to 1."""


class Reach(Body):
    """Estimate of the number of modules that a likeness takes."""

    likeness: float
    """Overlap of the modules and the mesh (`likeness.iou`)."""
    modules: int | None
    """About how many modules reach it; null if the largest number that can be folded does not."""


class Preview(Body):
    """Cells and path that a fold of the shape would use."""

    id: str
    key: str
    """Key of the options."""
    kind: Literal["path", "chain", "voxels", "mesh", "word", "picture"]
    name: str
    module: str
    """Name of the module."""
    module_words: ModuleWordsBody
    follows_paths: bool
    """True if a chain of these modules can follow each path through the cells of the cubic
    lattice."""
    modules: int
    asked: int | None
    below: int | None
    """The nearest reachable number of modules below."""
    above: int | None
    """The nearest reachable number of modules above."""
    iou: float | None
    """Same as `likeness.iou`."""
    likeness: LikenessBody | None = None
    """Likeness of the modules to the whole input with all its bodies; null for paths and chains,
    which are folded as they are."""
    volume_kept: float | None = None
    """Share of the mesh's volume inside the modules, 0 to 1."""
    tunnels: TunnelCounts | None = None
    """Holes through the shape; null if they cannot be counted."""
    keeps_parts: bool | None = None
    """False if the cells leave out a thin part of the mesh or a hole through it."""
    unused_bodies: list[float] = []
    """Shares of the mesh's volume of separate bodies that are left out."""
    reach: list[Reach] = []
    """About how many modules it takes to be 60, 75 and 90 % like a mesh; empty where this is not
    estimated: on a table, if the modules cannot follow each path, and if separate bodies are left
    out."""
    pitch: float | None
    """Distance between module centres, in the solid's own units."""
    method: str
    possible_methods: list[str] = list(PATH_METHODS)
    """Path methods that can work for this shape."""
    has_path: bool
    candidates: int
    """Number of paths that a fold will try in turn."""
    final: bool = True
    """False for a first result: a fold uses a better one. Send the request again without `quick` to
    get it."""
    cells: list[list[int]]
    """Cells, in path order if there is a path."""
    feasibility: Feasibility | None
    knot: Knot | None
    notes: list[str]
    repaired: str = ""
    """Changes that a repair made; empty without a repair."""
    added: list[list[int]] = []
    """Cells that a repair for a table added."""
    as_voxels: bool
    """True if a list of cells was read as a shape; send the same option with the fold."""
    start: list[int] | None
    """The requested start cell."""
    not_started: str
    """Reason why no path starts in that cell; the path then starts elsewhere. Empty if a path
    starts there."""
    expected_s: float
    """Estimated time of the fold, s, without waiting."""
    expected_as_published_s: float
    """Estimated time with the preset `paper`, s."""
    expected_preferred_s: float
    """Estimated time if the plan is optimised for time, torque or clearance, s."""
    positions: list[list[float]] | None
    """Positions of the folded chain's modules; null without a chain."""
    wxyzs: list[list[float]] | None
    """Orientations of the modules; null for cubes."""
    line: list[list[float]] | None
    """Line along the folded chain."""
    mesh: PlacedMesh | None
    """The solid, in the folded chain's coordinates."""
    missing: PlacedMesh | None = None
    """The parts of the solid's surface without modules up to 0.25 pitches behind them; null unless
    the file is a mesh."""
    links: PreviewLinks

    @classmethod
    def of(
        cls,
        preview_id: str,
        key: str,
        report: dict[str, Any],
        times: Mapping[str, float],
        *,
        full: bool,
    ) -> Preview:
        """Return the report of a preview; without cells, mesh and poses unless ``full``."""
        without = {
            "cells": [],
            "mesh": None,
            "missing": None,
            "positions": None,
            "wxyzs": None,
            "line": None,
        }
        large = {} if full else without
        details = {
            "id": preview_id,
            "key": key,
            **times,
            "links": PreviewLinks(page=f"/previews/{preview_id}", folds="/api/folds"),
        }
        return cls.model_validate({**report, **large, **details})


class TableChange(Body):
    """Options that an offer changes; null options stay as they are."""

    modules: int | None = None
    method: Literal["auto", "blocks"] | None = None
    repair: bool | None = None


class TableOffer(Body):
    """A version of a shape that can fold on a table, with a path that is supported throughout."""

    kind: Literal["repair", "modules", "blocks"]
    """`repair` adds cells, `modules` uses another number of modules, `blocks` makes 2×2×2 modules
    of each voxel."""
    modules: int
    """Number of modules."""
    change: TableChange
    """Options to send instead of the requested ones."""
    added: list[list[int]]
    """Cells that the repair adds."""


class TableOffers(Body):
    """Versions of a shape that can fold on a table, in the order in which they were found."""

    offers: list[TableOffer]


class FramesBody(Body):
    """A range of frames of a fold. Lengths are in pitches, angles in radians."""

    status: str
    """`growing`, `complete` or `failed`."""
    total: int
    """Number of frames."""
    start: int = Field(serialization_alias="from")
    stop: int = Field(serialization_alias="to")
    stride: int
    next: str | None
    """Link to the next frames, if not all fit into one response."""
    phases: list[str]
    """Meaning of the numbers in `phase`."""
    joint_names: list[str]
    time_s: list[float]
    phase: list[int]
    joint_angles_rad: list[list[float]]
    """(F, J) joint angles, rad."""
    root_position: list[list[float]]
    """(F, 3) position of the root module."""
    root_wxyz: list[list[float]]
    """(F, 4) orientation of the root module."""
    max_error_rad: list[float | None]
    """(F,) largest joint error; null in frames without one."""
    positions: list[list[list[float]]] | None
    """(F, n, 3) with poses=true."""
    wxyzs: list[list[list[float]]] | None
    """(F, n, 4) with poses=true."""


def moment(seconds: float) -> datetime:
    """Return a time of the clock with its time zone."""
    return datetime.fromtimestamp(seconds, UTC)


def progress_of(row: FoldRow, remaining: EtaEstimator) -> dict[str, Any]:
    """Return the progress of a fold, as its events tell it."""
    # At the start of a stage, the stored progress may still be that of the previous one.
    progress = row.progress if row.progress.get("stage") in (None, row.stage) else {}
    outlook = remaining.of(row)
    paused = row.status == "queued" and row.pauses > 0
    message = PAUSED_MESSAGE if paused else str(progress.get("message", ""))
    if row.stage == "explode" and row.smooths and not paused:
        message = SMOOTHING_MESSAGE  # smoothing runs in this stage, but is not an explosion
    return {
        "status": row.status,
        "stage": row.stage,
        "fraction": 1.0 if row.over else float(progress.get("fraction", 0.0)),
        "steps": int(progress.get("steps", 0)),
        "steps_per_second": float(progress.get("steps_per_second", 0.0)),
        "simulated_s": float(progress.get("simulated_s", 0.0)),
        "message": message,
        "plan": int(progress.get("plan", 0)),
        "plans": int(progress.get("plans", 0)),
        "modules": row.modules,
        "queue_position": outlook.place,
        "running_before": outlook.running,
        "paused": paused,
        "frames": int(row.progress.get("frames", 0)),
        "busy": row.status == "running" and bool(row.progress.get("busy", False)),
        "wait_s": outlook.wait_s,
        "remaining_s": outlook.remaining_s,
    }
