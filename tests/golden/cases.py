"""Small folds whose results are compared, each through all stages of a fold.

Together they use every strategy, module, preset, kind of playback and world.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Final, cast

import trimesh

from planner.chain.path import Path
from planner.pipeline.request import FoldRequest
from planner.pipeline.stages import run_stages
from planner.pipeline.workspace import Workspace
from planner.plan.plan import Plan
from planner.plan.shape_writers import write_chain, write_path
from tests.planner.chains import COIL, SQUARE, coil

SHAPES: Final = FilePath(__file__).parents[2] / "examples" / "shapes"
HOOK: Final = write_path(
    Path.from_cells(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1)], name="hook", pitch_m=0.02
    )
)
HAIRPIN: Final = write_path(
    Path.from_cells(
        [*((x, 0, 0) for x in range(4)), *((x, 1, 0) for x in reversed(range(4)))], name="hairpin"
    )
)
"""Path through as many cells as ``FLAT``."""
FLAT: Final = write_path(SQUARE)
LONG_COIL: Final = write_chain(coil(24))
CUBE: Final = json.dumps([[0, 0, 0]]).encode()
BOX: Final = json.dumps([[x, y, z] for z in range(2) for y in range(2) for x in range(2)]).encode()
TILE: Final = json.dumps([[x, y, 0] for y in range(3) for x in range(2)]).encode()
MESH: Final = cast("bytes", trimesh.creation.box((3.0, 2.0, 2.0)).export(file_type="stl"))


def _begin(directory: FilePath, request: FoldRequest, data: bytes) -> None:
    Workspace(directory).write_request(request, data)


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """Input of one fold.

    Attributes:
        data: Content of the file that is folded.
        request: Options of the fold.
        begin: Function that writes the plan to be smoothed or refolded; None if there is none.
    """

    data: bytes
    request: FoldRequest = FoldRequest()
    begin: Callable[[FilePath, FoldRequest, bytes], None] = _begin

    def fold(self, directory: FilePath, *, workers: int = 1) -> None:
        """Fold it in an empty directory, as ``foldback fold`` does."""
        self.begin(directory, self.request, self.data)
        run_stages(directory, workers=workers)


def _shape(name: str) -> bytes:
    return (SHAPES / f"{name}.json").read_bytes()


def _folded_square(directory: FilePath) -> Plan:
    """Return the plan of a fold, which stays in a directory below the given one."""
    first = directory / "first"
    first.mkdir()
    Case(data=FLAT, request=FoldRequest(settings="robots=0")).fold(first)
    return Workspace(first).read_plan()


def _begin_refold(directory: FilePath, request: FoldRequest, data: bytes) -> None:
    Workspace(directory).write_request(request, data, start=_folded_square(directory))


def _begin_smooth(directory: FilePath, request: FoldRequest, _: bytes) -> None:
    plan = _folded_square(directory)
    smoothing = FoldRequest.smoothing(plan, seed=request.seed, module_size=request.module_size)
    Workspace(directory).write_request(smoothing, write_chain(plan.chain), recorded=plan)


CASES: Final = {
    "all-at-once": Case(data=_shape("wrench-24"), request=FoldRequest(strategy="simultaneous")),
    "blocks": Case(data=_shape("mallet-24"), request=FoldRequest(strategy="blocks", seed=1)),
    "peeled": Case(data=LONG_COIL, request=FoldRequest(strategy="peel")),
    "peeled-kinematic": Case(
        data=LONG_COIL, request=FoldRequest(strategy="peel", settings="simulated_modules=9")
    ),
    "one-by-one": Case(data=write_path(COIL), request=FoldRequest(strategy="one-by-one")),
    "tetrahedra": Case(data=CUBE, request=FoldRequest(module="tetrahedron", as_voxels=True)),
    "paper": Case(data=HOOK, request=FoldRequest(preset="paper", settings="radial_gain=2")),
    "direct": Case(data=FLAT, request=FoldRequest(preset="direct")),
    "refold": Case(data=HAIRPIN, request=FoldRequest(refold=True), begin=_begin_refold),
    "smooth": Case(data=FLAT, begin=_begin_smooth),
    "prefer-time": Case(
        data=HOOK, request=FoldRequest(prefer="time", strategy="simultaneous", settings="robots=0")
    ),
    "mesh": Case(data=MESH, request=FoldRequest(filename="block.stl", modules=12)),
    "table-free": Case(
        data=TILE, request=FoldRequest(world="table", as_voxels=True, settings="table_friction=0.1")
    ),
    "table-clamped": Case(
        data=TILE,
        request=FoldRequest(
            world="table", as_voxels=True, settings="table_friction=0.1,table_base=clamped"
        ),
    ),
    "table-stuck": Case(
        data=BOX, request=FoldRequest(world="table", as_voxels=True, settings="table_torque=0.5")
    ),
}
