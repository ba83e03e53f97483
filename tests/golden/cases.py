"""Small folds whose results are compared, each through all stages of a fold.

Together they use every strategy, module, preset, kind of playback and world.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Any, Final, cast

import trimesh

from foldback.planner.chain.path import Path
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain, write_path
from tests.planner.chains import COIL, HAIRPIN, SQUARE, coil

SHAPES: Final = FilePath(__file__).parents[2] / "examples" / "shapes"
HOOK: Final = write_path(
    Path.from_cells(
        [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1)], name="hook", pitch_m=0.02
    )
)
FLAT: Final = write_path(SQUARE)
LONG_COIL: Final = write_chain(coil(24))
CUBE: Final = json.dumps([[0, 0, 0]]).encode()
BOX: Final = json.dumps([[x, y, z] for z in range(2) for y in range(2) for x in range(2)]).encode()
TILE: Final = json.dumps([[x, y, 0] for y in range(3) for x in range(2)]).encode()
MESH: Final = cast("bytes", trimesh.creation.box((3.0, 2.0, 2.0)).export(file_type="stl"))


Begin = Callable[[FilePath, FoldRequest, bytes], None]


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
    begin: Begin = _begin

    def fold(self, directory: FilePath, *, workers: int = 1) -> None:
        """Fold it in an empty directory, as ``foldback fold`` does."""
        self.begin(directory, self.request, self.data)
        run_stages(directory, workers=workers)


def _shape(name: str) -> bytes:
    return (SHAPES / f"{name}.json").read_bytes()


def _folded_square(directory: FilePath) -> Plan:
    """Return the plan of a fold, whose files remain in a subdirectory of the given directory."""
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


def _case(data: bytes, first_begin: Begin = _begin, **options: Any) -> Case:
    return Case(data=data, request=FoldRequest(**options), begin=first_begin)


_ON_TABLE: Final = {"world": "table", "as_voxels": True}
CASES: Final = {
    "all-at-once": _case(_shape("wrench-24"), strategy="simultaneous"),
    "blocks": _case(_shape("mallet-24"), strategy="blocks", seed=1),
    "peeled": _case(LONG_COIL, strategy="peel"),
    "peeled-kinematic": _case(LONG_COIL, strategy="peel", settings="simulated_modules=9"),
    "one-by-one": _case(write_path(COIL), strategy="one-by-one"),
    "tetrahedra": _case(CUBE, module="tetrahedron", as_voxels=True),
    "paper": _case(HOOK, preset="paper", settings="radial_gain=2"),
    "direct": _case(FLAT, preset="direct"),
    "refold": _case(write_path(HAIRPIN), _begin_refold, refold=True),
    "smooth": _case(FLAT, _begin_smooth),
    "prefer-time": _case(HOOK, prefer="time", strategy="simultaneous", settings="robots=0"),
    "mesh": _case(MESH, filename="block.stl", modules=12, method="blocks"),
    "table-free": _case(TILE, **_ON_TABLE, settings="table_friction=0.1"),
    "table-clamped": _case(TILE, **_ON_TABLE, settings="table_friction=0.1,table_base=clamped"),
    "table-stuck": _case(BOX, **_ON_TABLE, settings="table_torque=0.5"),
}
