"""Preparation: from the bytes of a file to the chains that may fold into what is in it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from planner.chain import Chain
from planner.decimation import decimated
from planner.errors import InputError
from planner.feasibility import Feasibility, Repair, apply_repair, feasibility
from planner.knots import Knot, knot_of
from planner.pathfinding.candidates import METHODS, PathSearch, find_paths, halved
from planner.pathfinding.obstacles import Cell
from planner.paths import Path
from planner.readers import read
from planner.shapes import Shape
from planner.solids import Solid
from planner.starts import started
from planner.voxeliser import Voxels, voxelise

Array = NDArray[np.float64]
DEFAULT_MODULES: Final = 160
MODULES: Final = (8, 20_000)
ENDS: Final = ("any", "surface")
BLOCK: Final = 8
"""Cells of a doubled voxel."""
LARGEST_MESH: Final = 20_000
SEARCH_S: Final = 20.0
DOUBLING_REACH: Final = 1.25
"""Times the modules asked for that a repair by doubling may come to."""
START_SHARE: Final = 0.7
"""Part of that time for paths that begin where it is wished for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """How a shape is to become a path.

    Attributes:
        modules: About how many modules; None for what the input has, or 160 for a mesh.
        method: ``auto``, ``blocks``, ``exact`` or ``snake``.
        repair: Whether cells may be added or dropped where there is no path otherwise.
        ends: ``any``, or ``surface`` for both ends on the outside.
        as_voxels: Read a list of cells as a shape, not as a path.
        start: The cell that the chain begins in, as the preview counts cells; None for any.
    """

    modules: int | None = None
    method: str = "auto"
    repair: bool = False
    ends: str = "any"
    as_voxels: bool = False
    start: Cell | None = None

    def check(self) -> None:
        """Refuses what cannot be wished for.

        Raises:
            InputError: Naming the wish.
        """
        low, high = MODULES
        if self.modules is not None and not low <= self.modules <= high:
            raise InputError(
                "bad-modules", f"got {self.modules} modules, expected {low} to {high}."
            )
        for name, value, known in (
            ("method", self.method, METHODS),
            ("ends", self.ends, ENDS),
        ):
            if value not in known:
                raise InputError(
                    f"unknown-{name}",
                    f"got the {name} {value!r}, expected one of: {', '.join(known)}.",
                )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Preparation:
    """What became of an input.

    Attributes:
        kind: ``path``, ``chain``, ``voxels`` or ``mesh``: what the input was.
        name: What people call it.
        wishes: What was asked for.
        chains: Candidates, best first; empty when no path was found.
        solid, voxels: The mesh and how it was voxelised; None for other inputs.
        shape: The cells that are filled; None for a chain file.
        method: How the paths were found; empty for paths and chains.
        feasibility: Whether the cells have a path at all; None for paths and chains.
        knot: Of the first candidate; None without one.
        notes: What people should know, in plain words.
        not_started: Why no chain begins where it was wished for; empty when they do, or when
            nothing of the kind was wished for.
    """

    kind: str
    name: str
    wishes: Wishes
    chains: tuple[Chain, ...]
    solid: Solid | None = None
    voxels: Voxels | None = None
    shape: Shape | None = None
    method: str = ""
    feasibility: Feasibility | None = None
    knot: Knot | None = None
    notes: tuple[str, ...] = field(default=())
    not_started: str = ""

    @property
    def chain(self) -> Chain:
        """The best candidate.

        Raises:
            InputError: ``no-path``, saying why there is none and what would help; ``no-start`` when
                there are others than those that were wished for.
        """
        if self.not_started:
            raise InputError("no-start", f"{self.not_started} Start elsewhere, or anywhere.")
        if self.chains:
            return self.chains[0]
        problems = [] if self.feasibility is None else list(self.feasibility.problems)
        why = " ".join(problem.detail for problem in problems) or " ".join(self.notes)
        remedy = ""
        if self.feasibility is not None and self.feasibility.repairs:
            remedy = f" A repair is at hand: {self.feasibility.repairs[0].detail}"
        raise InputError("no-path", f"no path through these cells was found. {why}{remedy}".strip())

    def report(self, *, full: bool = True) -> dict[str, Any]:
        """Everything a page shows of it, as plain JSON values; its mesh only when ``full``."""
        voxels = self.voxels
        cells = self.cells
        return {
            "kind": self.kind,
            "name": self.name,
            "modules": len(cells),
            "asked": self.wishes.modules,
            "below": None if voxels is None else self._scaled(voxels.below),
            "above": None if voxels is None else self._scaled(voxels.above),
            "iou": None if voxels is None else voxels.iou,
            "pitch": None if voxels is None else voxels.pitch / self._doubling,
            "method": self.method,
            "has_path": bool(self.chains),
            "candidates": len(self.chains),
            "cells": cells.tolist(),
            "feasibility": None
            if self.feasibility is None or self.shape is None
            else _feasibility(self.feasibility, self.shape),
            "knot": None
            if self.knot is None
            else {"verdict": self.knot.verdict, "determinant": self.knot.determinant},
            "notes": list(self.notes),
            "as_voxels": self.wishes.as_voxels,
            "start": None if self.wishes.start is None else list(self.wishes.start),
            "not_started": self.not_started,
            "expected_s": expected_seconds(len(cells)),
            "mesh": self._mesh() if full else None,
        }

    @property
    def _doubling(self) -> int:
        return 2 if self.voxels is not None and self.method == "blocks" else 1

    def _scaled(self, count: int | None) -> int | None:
        return None if count is None else count * self._doubling**3

    @property
    def cells(self) -> NDArray[np.int64]:
        """(n, 3) in the order of the best path; as they lie when there is none."""
        if self.chains:
            return np.rint(self.chains[0].folded_poses.positions).astype(np.int64)
        return np.zeros((0, 3), dtype=np.int64) if self.shape is None else self.shape.cells

    def _mesh(self) -> dict[str, Any] | None:
        """The solid in the cells' coordinates, a cell's centre at its whole numbers."""
        solid, voxels = self.solid, self.voxels
        if solid is None or voxels is None:
            return None
        scale = float(self._doubling)
        vertices, faces = decimated(solid.vertices, solid.faces, most=LARGEST_MESH)
        placed = vertices @ voxels.rotation.T / voxels.pitch + voxels.offset
        return {
            "vertices": np.round(scale * placed - 0.5, 4).tolist(),
            "faces": faces.tolist(),
        }


def prepare(
    data: bytes,
    filename: str | None,
    wishes: Wishes | None = None,
    *,
    seed: int = 0,
    time_limit_s: float = SEARCH_S,
) -> Preparation:
    """Reads a file and finds the chains that may fold into what is in it.

    Args:
        data: The whole file.
        filename: What it was called.
        wishes: How a shape is to become a path.
        seed: What randomness starts from.
        time_limit_s: How long a path through exact cells may be searched for.

    Returns:
        The preparation, with no chains when there is no path: it then says why.

    Raises:
        InputError: When the file cannot be used, or a wish cannot be wished for.
    """
    wishes = Wishes() if wishes is None else wishes
    wishes.check()
    found = read(data, filename=filename, as_voxels=wishes.as_voxels)
    if isinstance(found, Chain):
        return _prepared_chain(found, wishes, "chain")
    if isinstance(found, Path):
        return _prepared_chain(Chain.from_path(found), wishes, "path")
    if isinstance(found, Shape):
        return _from_shape(found, wishes, seed, time_limit_s)
    return _from_solid(found, wishes, seed, time_limit_s)


def expected_seconds(modules: int) -> float:
    """About how long a fold takes on two cores, from measured runs of 24 to 512 modules."""
    return 1.0 + 0.006 * modules + 1.4 * (modules / 160.0) ** 2.6


def _prepared_chain(chain: Chain, wishes: Wishes, kind: str) -> Preparation:
    notes = ()
    if wishes.modules is not None and wishes.modules != len(chain):
        notes = (f"A {kind} is folded as it is: it has {len(chain)} modules.",)
    chain, not_started = started(chain, wishes.start)
    return Preparation(
        kind=kind,
        name=chain.name,
        wishes=wishes,
        chains=(chain,),
        knot=knot_of(chain.folded_poses.positions),
        notes=notes,
        not_started=not_started,
    )


def _from_shape(shape: Shape, wishes: Wishes, seed: int, time_limit_s: float) -> Preparation:
    notes: list[str] = []
    if wishes.method == "blocks" and halved(shape) is None:
        notes.append("Each voxel became 2×2×2 modules, so that there is a path in any case.")
        shape = doubled(shape)
    elif wishes.modules is not None and wishes.modules != len(shape.cells) and not wishes.repair:
        notes.append(f"Voxels are taken as they are: {len(shape.cells)} modules.")
    return _with_paths(
        Preparation(kind="voxels", name=shape.name, wishes=wishes, chains=()),
        shape,
        wishes.method,
        tuple(notes),
        seed,
        time_limit_s,
    )


def _from_solid(solid: Solid, wishes: Wishes, seed: int, time_limit_s: float) -> Preparation:
    modules = DEFAULT_MODULES if wishes.modules is None else wishes.modules
    blocks = wishes.method in ("auto", "blocks")
    cells = max(1, round(modules / BLOCK)) if blocks else modules
    voxels = voxelise(solid, cells=cells, seed=seed)
    shape = doubled(voxels.shape) if blocks else voxels.shape
    made = Preparation(
        kind="mesh", name=solid.name, wishes=wishes, chains=(), solid=solid, voxels=voxels
    )
    return _with_paths(
        made,
        shape,
        "blocks" if blocks else wishes.method,
        (*solid.notes, *voxels.notes),
        seed,
        time_limit_s,
    )


def _with_paths(
    made: Preparation,
    shape: Shape,
    method: str,
    notes: tuple[str, ...],
    seed: int,
    time_limit_s: float,
) -> Preparation:
    wishes = made.wishes
    state = feasibility(shape)
    if state.feasible is False and wishes.repair and state.repairs:
        repair = wished_repair(shape, state, wishes)
        if repair is not None:
            shape = apply_repair(shape, repair)
            notes = (*notes, f"Repaired: {repair.detail}")
            state = feasibility(shape)
        else:
            notes = (*notes, only_doubling(shape, state.repairs[0]))
    search: PathSearch | None = None
    not_started = ""
    if state.feasible is not False:
        search, not_started = _searched(shape, method, wishes, seed, time_limit_s)
        notes = (*notes, *search.notes, *((search.reason,) if search.reason else ()))
    chains = () if search is None else tuple(Chain.from_path(path) for path in search.paths)
    return Preparation(
        kind=made.kind,
        name=made.name,
        wishes=wishes,
        chains=chains,
        solid=made.solid,
        voxels=made.voxels,
        shape=shape,
        method=method if search is None else search.method,
        feasibility=state,
        knot=knot_of(search.paths[0].cells) if search is not None and search.paths else None,
        notes=notes,
        not_started=not_started,
    )


def _searched(
    shape: Shape, method: str, wishes: Wishes, seed: int, time_limit_s: float
) -> tuple[PathSearch, str]:
    """Paths that begin where it is wished for; others, and why, where there are none."""
    begun = time.monotonic()
    share = 1.0 if wishes.start is None else START_SHARE
    search = find_paths(
        shape,
        method=method,
        ends=wishes.ends,
        start=wishes.start,
        seed=seed,
        time_limit_s=share * time_limit_s,
    )
    if wishes.start is None or search.paths:
        return search, ""
    why = f"No path that begins in the cell {wishes.start} was found. {search.reason}".strip()
    left = time_limit_s - (time.monotonic() - begun)
    return find_paths(
        shape, method=method, ends=wishes.ends, seed=seed, time_limit_s=max(0.5, left)
    ), why


def wished_repair(shape: Shape, state: Feasibility, wishes: Wishes) -> Repair | None:
    """The smallest repair; one that makes eight modules of each cell only where so many are wanted.

    Returns:
        None when nothing but that helps and it was not asked for.
    """
    repair = state.repairs[0]
    count = modules_after(shape, repair)
    wanted = wishes.modules is not None and count <= DOUBLING_REACH * wishes.modules
    return repair if wanted or not repair.doubled else None


def modules_after(shape: Shape, repair: Repair) -> int:
    """How many modules a repair leaves."""
    cells = len(shape) + len(repair.add) - len(repair.drop)
    return BLOCK * cells if repair.doubled else cells


def only_doubling(shape: Shape, repair: Repair) -> str:
    """What to say where only doubling helps and was not asked for."""
    count = modules_after(shape, repair)
    return (
        f"Only one repair was found, which makes {count} modules of {len(shape)} cells: "
        f"{repair.detail} Ask for {count} modules with the repair, or for the method 'blocks'."
    )


def doubled(shape: Shape) -> Shape:
    """Each cell as 2×2×2 cells of half the pitch."""
    corners = np.array([(x, y, z) for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    cells = (2 * shape.cells[:, None, :] + corners).reshape(-1, 3)
    return Shape.from_cells(cells, name=shape.name, pitch_m=0.5 * shape.pitch_m)


def _feasibility(state: Feasibility, shape: Shape) -> dict[str, Any]:
    return {
        "feasible": state.feasible,
        "problems": [
            {"code": p.code, "detail": p.detail, "cells": [list(map(int, c)) for c in p.cells]}
            for p in state.problems
        ],
        "repairs": [
            {
                "detail": r.detail,
                "add": [list(map(int, c)) for c in r.add],
                "drop": [list(map(int, c)) for c in r.drop],
                "doubled": r.doubled,
                "modules": modules_after(shape, r),
            }
            for r in state.repairs
        ],
    }
