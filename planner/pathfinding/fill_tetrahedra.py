"""Cells filled with tetrahedra: a ring of twelve in each, along one Eulerian trail."""

from __future__ import annotations

import numpy as np

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.honeycomb import TETRAHEDRA_PER_RING, ring_of
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.feasibility import Feasibility, Repair, apply_repair
from foldback.planner.pathfinding.filled_shape import FilledShape
from foldback.planner.pathfinding.knots import knot_of
from foldback.planner.pathfinding.lattice import parts, tuples
from foldback.planner.pathfinding.no_path_proofs import disconnected
from foldback.planner.pathfinding.path_options import DEFAULT_MODULES, PathOptions
from foldback.planner.pathfinding.path_reasons import PathReason, sentences
from foldback.planner.pathfinding.trail_search import find_trails
from foldback.planner.shapes.shape import Shape


class Tetrahedra:
    """Filling with rings of tetrahedra; any connected cells have a trail."""

    def cells_for(self, options: PathOptions) -> int:
        """Return the number of cells for the voxelisation of a solid."""
        modules = DEFAULT_MODULES if options.modules is None else options.modules
        return max(1, round(modules / TETRAHEDRA_PER_RING))

    def modules_of(self, shape: Shape, options: PathOptions, *, of_solid: bool) -> int:
        """Return the number of modules of given cells."""
        del options, of_solid
        return TETRAHEDRA_PER_RING * len(shape)

    def fill(
        self, shape: Shape, options: PathOptions, *, of_solid: bool, seed: int, time_limit_s: float
    ) -> FilledShape:
        """Find chains through cells; see ``planner.pathfinding.filling_methods.FillingMethod``."""
        del time_limit_s
        notes: tuple[str, ...] = ()
        if not of_solid:
            notes = (f"Each cell became a ring of {TETRAHEDRA_PER_RING} tetrahedra.",)
        state, repaired = _feasibility(shape), ""
        if state.repairs and options.repair:
            repaired = state.repairs[0].done
            shape = apply_repair(shape, state.repairs[0])
            state = _feasibility(shape)
        chains: tuple[Chain, ...] = ()
        not_started: tuple[PathReason, ...] = ()
        knot = None
        cells, line = shape.cells, np.zeros((0, 3))
        if state.feasible:
            search = find_trails(shape, ends=options.ends, start=options.start, seed=seed)
            if not search.trails:
                not_started = search.reasons
                search = find_trails(shape, ends=options.ends, seed=seed)
            chains = tuple(Chain.from_trail(trail) for trail in search.trails)
            nodes = search.trails[0].nodes
            knot = knot_of(nodes)
            cells, line = shape.cells[ring_of(nodes, shape.cells)], nodes.astype(np.float64)
        return FilledShape(
            chains=chains,
            shape=shape,
            method="rings",
            feasibility=state,
            cells=cells,
            line=line,
            knot=knot,
            notes=notes,
            not_started=not_started,
            scale=2.0,
            shift=1.0,
            modules_per_cell=TETRAHEDRA_PER_RING,
            repaired=repaired,
        )

    def check(self, shape: Shape, options: PathOptions) -> None:
        """Refuse given cells without a trail."""
        state = _feasibility(shape)
        if not state.feasible and not options.repair:
            reasons = [problem.reason for problem in state.problems]
            raise InputError(
                "no-path",
                f"got cells that no chain of tetrahedra can fill. {sentences(reasons)} Use the "
                f"option 'repair' to change the shape: {state.repairs[0].as_step}",
                reasons=[reason.as_dict() for reason in reasons],
            )


def _feasibility(shape: Shape) -> Feasibility:
    """Return feasibility: the cells must be connected by faces, which trails pass."""
    count, labels = parts(shape.cells)
    if count == 1:
        return Feasibility(feasible=True)
    loose = shape.cells[labels != np.argmax(np.bincount(labels))]
    cells = tuples(loose)
    loose_text = "cell" if len(cells) == 1 else f"{len(cells)} cells"
    return Feasibility(
        feasible=False,
        problems=(disconnected(shape.cells, labels),),
        repairs=(
            Repair(
                detail=f"Keep the largest part and remove the other {loose_text}.",
                done=f"kept the largest part and removed the other {loose_text}.",
                drop=cells,
            ),
        ),
    )
