"""Preparation: from the bytes of a file to the chains that may fold into its shape."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.built_in_modules import module_value
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import LONG_CHAIN
from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.pathfinding import PATH_METHODS
from foldback.planner.pathfinding.knots import Knot, knot_of
from foldback.planner.pathfinding.path_options import (
    DEFAULT_DRAWN_MODULES,
    DEFAULT_MODULES,
    PathOptions,
)
from foldback.planner.pathfinding.path_reasons import PathReason, sentences
from foldback.planner.pathfinding.snake import is_box
from foldback.planner.pathfinding.snake_cubes import box_chains
from foldback.planner.pathfinding.start_cell import starting_at
from foldback.planner.plan.prepared_chains import PreparedChains
from foldback.planner.readers import read
from foldback.planner.readers.formats import Content
from foldback.planner.shapes.likeness import Likeness
from foldback.planner.shapes.shape import MAX_CELLS, Shape
from foldback.planner.silhouettes.picture import Picture
from foldback.planner.silhouettes.word import Word
from foldback.planner.twist_chains.cube_sequence import CubeSequence

# What reads meshes and fills cells is imported for those: a path or a chain needs none of it.
if TYPE_CHECKING:
    from foldback.planner.pathfinding.feasibility import Feasibility
    from foldback.planner.pathfinding.filling_methods import FilledShape, FillingMethod
    from foldback.planner.shapes.inside_points import InsidePoints
    from foldback.planner.shapes.solid import Solid
    from foldback.planner.shapes.voxel_choice import Chooser
    from foldback.planner.shapes.voxelise import Voxels

MAX_LISTED_VIOLATIONS: Final = 2
"""Maximum number of violated rules that the error for an unsuitable path for a table names; further
ones are only counted."""
TABLE_REMEDY: Final = (
    "Choose the method 'blocks', a repair, or another number of modules, or fold the shape in zero "
    "gravity."
)
"""Advice at the end of the error message for a shape that has no path along which a chain folds on
a table."""
PATH_SEARCH_LIMIT_S: Final = 20.0
"""Default time limit of the path search, in s."""
MIN_MODULES: Final = 8
"""Smallest number of modules that is suggested."""
MIN_FITTED_GAIN: Final = 0.02
"""Smallest gain in IoU for which a fitted path is taken instead of blocks, along which chains fold
most reliably; none is needed if only the fitted path keeps all parts of the solid."""
TIME_INDEPENDENT_METHODS: Final = ("blocks", "fitted", "snake", "assembly")
"""Methods of searching a path through a shape whose result does not depend on a time limit, and so
is the same on every machine. Only their chains may be stored by a preview and used by the fold."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Preparation:
    """Result of reading an input and searching its chains.

    Attributes:
        kind: What the input was: ``path``, ``chain``, ``voxels``, ``mesh``, ``word``, ``picture``.
        name: Name for people.
        options: Requested options.
        chains: Candidates, best first; empty when no path was found.
        solid, voxels: The mesh and how it was voxelised; None for other inputs.
        shape: The cells that are filled; None for a chain file.
        method: Method that found the paths; empty for paths and chains.
        feasibility: Result of the check for a path; None for paths and chains.
        knot: Knot of the first candidate; None without one.
        notes: Notes for people.
        not_started: Reasons why no chain starts in the requested cell; empty if they do, or if none
            was requested.
        filled: Cells and their modules; None for paths and chains.
        likenesses: Likeness of each chain to the whole input, without chains that of the cells;
            empty for paths and chains, which are folded as they are.
        reach: About how many modules reach each likeness (IoU), None if the largest number does
            not; empty if that was not estimated.
        final: False for a first result that a further search is likely to improve.
    """

    kind: str
    name: str
    options: PathOptions
    chains: tuple[Chain, ...]
    solid: Solid | None = None
    voxels: Voxels | None = None
    shape: Shape | None = None
    method: str = ""
    feasibility: Feasibility | None = None
    knot: Knot | None = None
    notes: tuple[str, ...] = field(default=())
    not_started: tuple[PathReason, ...] = ()
    filled: FilledShape | None = None
    likenesses: tuple[Likeness, ...] = ()
    reach: Mapping[float, int | None] = field(default_factory=dict[float, int | None])
    final: bool = True

    @property
    def sentences(self) -> tuple[str, ...]:
        """Notes for people, each beginning with a capital letter."""
        return tuple(f"{note[:1].upper()}{note[1:]}" for note in self.notes)

    @property
    def repaired(self) -> str:
        """Phrase that says what a repair changed; empty without a repair."""
        return "" if self.filled is None else self.filled.repaired

    @property
    def likeness(self) -> Likeness | None:
        """Likeness of the best chain to the whole input; None for paths and chains."""
        return next(iter(self.likenesses), None)

    @property
    def chain(self) -> Chain:
        """The best candidate.

        Raises:
            InputError: ``no-path``, saying why there is none and what would help; ``no-start`` when
                there are others than those that were wished for.
        """
        if self.not_started:
            remedy = "Choose another start cell, or let foldback choose it."
            raise InputError(
                "no-start",
                f"{sentences(self.not_started)} {remedy}",
                reasons=[reason.as_dict() for reason in self.not_started],
            )
        if self.chains:
            return self.chains[0]
        problems = [] if self.feasibility is None else list(self.feasibility.problems)
        causes = " ".join([problem.sentence for problem in problems] or self.sentences)
        remedy = ""
        on_table = self.options.world == "table"
        if on_table:
            remedy = f"{self._nearest_on_table()} {TABLE_REMEDY}"
        elif self.feasibility is not None and self.feasibility.repairs:
            remedy = f" Possible repair: {self._nearest(self.feasibility)}"
        problem = "no path through these cells was found"
        if on_table:
            problem = (
                "no path along which a chain can fold on a table was found through these cells"
            )
        problem += f". {causes}" if causes else "."
        reasons = [cause.reason for cause in problems]
        if not reasons and self.filled is not None:
            reasons = self.filled.reasons
        raise InputError(
            "no-path", problem + remedy, reasons=[reason.as_dict() for reason in reasons]
        )

    def _nearest_on_table(self) -> str:
        """Return a sentence on the nearest cells or number with a path for a table, or nothing."""
        from foldback.planner.path_fit.fit_table import MAX_TABLE_FITTED_MODULES
        from foldback.planner.table_paths.mending import nearest_words

        if self.shape is None or self.options.repair:
            return ""
        if self.solid is None:
            return nearest_words(self.shape.cells)
        modules = DEFAULT_MODULES if self.options.modules is None else self.options.modules
        if self.options.method != "auto" or modules <= MAX_TABLE_FITTED_MODULES:
            return ""
        return (
            f" With at most {MAX_TABLE_FITTED_MODULES} modules, the cells are chosen together with "
            "a path for a table."
        )

    def _nearest(self, state: Feasibility) -> str:
        """Return the nearest sets of cells that have a path, to follow a colon."""
        from foldback.planner.pathfinding.fill_cubes import repair_words

        if self.shape is None or not self.options.kind.follows_paths:
            return state.repairs[0].as_step
        return repair_words(self.shape, state)

    @property
    def repeatable(self) -> bool:
        """True if a fold, which has another time limit, finds the same chains."""
        started = bool(self.chains) and not self.not_started
        return started and self.final and self.method in TIME_INDEPENDENT_METHODS

    def prepared(self) -> PreparedChains:
        """Return the chains and how they were found.

        Raises:
            InputError: If there is no chain, as ``chain``.
        """
        _ = self.chain
        return PreparedChains(
            kind=self.kind,
            method=self.method,
            notes=(*((f"Repaired: {self.repaired}",) if self.repaired else ()), *self.sentences),
            knot=None if self.knot is None else self.knot.verdict,
            chains=self.chains,
            likenesses=self.likenesses,
        )

    def report(self, *, full: bool = True) -> dict[str, Any]:
        """Return all that a page shows of it, as plain JSON values; its mesh only if ``full``."""
        voxels = self.voxels
        cells = self.cells
        module = self.chains[0].module if self.chains else self.options.kind
        return {
            "kind": self.kind,
            "name": self.name,
            "modules": len(cells),
            "asked": self.options.modules,
            "below": None if voxels is None else self._scaled(voxels.below),
            "above": None if voxels is None else self._scaled(voxels.above),
            "iou": None if self.likeness is None else self.likeness.iou,
            "likeness": None if self.likeness is None else self.likeness.as_dict(),
            **self._retention_fields(),
            "pitch": None
            if voxels is None or self.filled is None
            else voxels.pitch / self.filled.scale,
            "method": self.method,
            "possible_methods": self._possible_methods(),
            "has_path": bool(self.chains),
            "candidates": len(self.chains),
            "final": self.final,
            "cells": cells.tolist(),
            "feasibility": None
            if self.feasibility is None or self.shape is None
            else _feasibility(self.feasibility, self.shape),
            "knot": None
            if self.knot is None
            else {"verdict": self.knot.verdict, "determinant": self.knot.determinant},
            "notes": list(self.sentences),
            "repaired": self.repaired,
            "added": [] if self.filled is None else [list(cell) for cell in self.filled.added],
            "as_voxels": self.options.as_voxels,
            "start": None if self.options.start is None else list(self.options.start),
            "not_started": sentences(self.not_started),
            "module": module.name,
            "module_words": asdict(module.words),
            "module_value": module_value(module),
            "follows_paths": module.follows_paths,
            **(self._meshes() if full else {"mesh": None, "missing": None}),
            **(self._modules() if full else {}),
        }

    def _retention_fields(self) -> dict[str, Any]:
        """Return what the modules keep of a mesh, and what other numbers of modules would."""
        voxels = self.voxels
        if voxels is None:
            return {
                **dict.fromkeys(("volume_kept", "tunnels", "keeps_parts")),
                "unused_bodies": [],
                "reach": [],
            }
        return {
            "volume_kept": None if self.likeness is None else 1.0 - self.likeness.missing,
            "tunnels": None
            if voxels.tunnels is None
            else {"mesh": voxels.tunnels, "cells": voxels.retention.tunnels},
            "keeps_parts": voxels.retention.parts,
            "unused_bodies": list(voxels.unused),
            "reach": [
                {"likeness": likeness, "modules": modules}
                for likeness, modules in self.reach.items()
            ],
        }

    def _possible_methods(self) -> list[str]:
        """Return the methods that may find a path through the shape."""
        if self.shape is None:
            return list(PATH_METHODS)
        if self.options.world == "table":
            return [method for method in PATH_METHODS if method != "fitted"]
        may_fit = self.solid is not None and self.options.kind.follows_paths
        unsuited = {"snake"} if may_fit else {"snake", "fitted"}
        methods = [method for method in PATH_METHODS if method not in unsuited]
        solid = self.solid
        if is_box(self.shape) or (solid is not None and solid.fills_its_box):
            methods.append("snake")
        return methods

    def _scaled(self, count: int | None) -> int | None:
        if count is None or self.filled is None:
            return None
        return count * self.filled.modules_per_cell

    @property
    def cells(self) -> Ints:
        """(n, 3) a cell for each module of the best chain; as they lie when there is none."""
        if self.filled is not None:
            return self.filled.cells
        if self.chains:
            return np.rint(self.chains[0].folded_poses.positions).astype(np.int64)
        return np.zeros((0, 3), dtype=np.int64) if self.shape is None else self.shape.cells

    def _modules(self) -> dict[str, Any]:
        """Return the poses and course of the best chain's modules; None without a chain."""
        if not self.chains:
            return {"positions": None, "wxyzs": None, "line": None}
        poses = self.chains[0].folded_poses
        line = poses.positions if self.filled is None else self.filled.line
        # Modules that fill cells look the same in all orientations of the lattice.
        upright = self.chains[0].module.fills_cell
        return {
            "positions": np.round(poses.positions, 4).tolist(),
            "wxyzs": None if upright else np.round(poses.wxyzs, 5).tolist(),
            "line": np.round(line, 4).tolist(),
        }

    def _meshes(self) -> dict[str, Any]:
        """Return the solid in the folded chain's space, and its surface without modules."""
        solid, voxels = self.solid, self.voxels
        if solid is None or voxels is None or self.filled is None:
            return {"mesh": None, "missing": None}
        from foldback.planner.pathfinding.shape_overlap import regions_of
        from foldback.planner.shapes.decimation import decimated
        from foldback.planner.shapes.uncovered_surface import uncovered_surface

        vertices, faces = decimated(solid.vertices, solid.faces, max_faces=20_000)
        in_cells = vertices @ voxels.rotation.T / voxels.pitch + voxels.offset
        placed = self.filled.placed(in_cells)
        modules = self.chains[0] if self.chains else self.filled.shape.cells
        regions = regions_of(modules)
        missing = uncovered_surface(placed, faces, regions, oriented=solid.oriented)
        corners = np.arange(3 * len(missing)).reshape(-1, 3)
        return {"mesh": _listed(placed, faces), "missing": _listed(missing, corners)}


def _listed(vertices: Array, faces: Ints) -> dict[str, Any]:
    """Return a mesh as plain JSON values."""
    rows = np.round(vertices.reshape(-1, 3), 3)
    return {"vertices": rows.tolist(), "faces": faces.tolist()}


def prepare(
    source: bytes | Content,
    filename: str | None,
    options: PathOptions | None = None,
    *,
    seed: int = 0,
    time_limit_s: float = PATH_SEARCH_LIMIT_S,
) -> Preparation:
    """Read a file and find the chains that may fold into what is in it; see ``prepare_subject``.

    Args:
        source: The whole file, or what would be read from it.
        filename: Name of the file.
        options: Options that turn a shape into a path.
        seed: Random seed.
        time_limit_s: Time limit of the search for a path through exact cells, s.

    Raises:
        InputError: When the file cannot be used, or a wish cannot be wished for.
    """
    options = PathOptions() if options is None else options
    options.check()
    if isinstance(source, bytes):
        source = read(source, filename=filename, as_voxels=options.as_voxels)
    return prepare_subject(source, options, seed=seed, time_limit_s=time_limit_s)


def prepare_subject(
    shape: Content,
    options: PathOptions,
    *,
    seed: int = 0,
    time_limit_s: float = PATH_SEARCH_LIMIT_S,
    searching: bool = True,
    offering: bool = False,
    quick: bool = False,
) -> Preparation:
    """Find the chains that may fold into what was read from a file.

    Args:
        shape: Content of the file.
        options: Options that turn a shape into a path.
        seed: Random seed.
        time_limit_s: Time limit of the search for a path through exact cells, s.
        searching: True to search a path for voxels and meshes; else they remain cells.
        offering: True to estimate, for a mesh, how many modules reach a likeness.
        quick: True for the first result of a fit of a path to a mesh, which is not final. Other
            searches have no first result, and are complete.

    Returns:
        The preparation, with no chains when there is no path: it then says why.

    Raises:
        InputError: When the content cannot be used, or a wish cannot be wished for.
    """
    if isinstance(shape, CubeSequence):
        chains = box_chains(shape, seed=seed)
        return replace(prepare_subject(chains[0], options), chains=chains)
    if isinstance(shape, Chain):
        if options.world == "table":
            check_for_table(shape)
        return _prepared_chain(shape, options, "chain")
    if isinstance(shape, Path) and options.kind.follows_paths:
        chain = Chain.from_path(shape)
        if options.world == "table":
            check_for_table(chain)
        return _prepared_chain(chain, options, "path")
    if isinstance(shape, Path):
        # The cells of a path are a shape to other modules.
        shape = Shape.from_cells(shape.cells, name=shape.name, pitch_m=shape.pitch_m)
    if options.method == "fitted":
        _check_for_fitted(shape, options)
    if isinstance(shape, Word | Picture):
        return _from_drawing(shape, options, seed, time_limit_s, searching)
    if not searching:
        return _cells_alone(shape, options, seed)
    if isinstance(shape, Shape):
        return _from_shape("voxels", shape, options, seed, time_limit_s)
    if quick and _has_first_result(options):
        return _fitted(shape, options, seed, quick=True)
    preparation = _from_solid(shape, options, seed, time_limit_s)
    return replace(preparation, reach=_reach(shape, preparation)) if offering else preparation


def _reach(solid: Solid, preparation: Preparation) -> dict[float, int | None]:
    """Return about how many modules reach each likeness in zero gravity.

    It is the smaller number of a fitted path, below ``LONG_CHAIN``, and of blocks. Empty where that
    cannot be estimated: for other modules, on a table, and for solids of which separate bodies are
    left out.
    """
    from foldback.planner.pathfinding.fill_cubes import BLOCK_CELLS
    from foldback.planner.shapes.reachable_likeness import LEVELS, CellUse, cells_reaching

    options, voxels = preparation.options, preparation.voxels
    if not options.kind.follows_paths or options.world == "table" or preparation.filled is None:
        return {}
    if voxels is None or voxels.unused:
        return {}
    uses = {
        BLOCK_CELLS: CellUse(
            min_cells=MIN_MODULES // BLOCK_CELLS, max_cells=MAX_CELLS // BLOCK_CELLS
        ),
        1: CellUse(min_cells=MIN_MODULES, max_cells=LONG_CHAIN - 10, in_path=True),
    }
    if options.method == "blocks":
        del uses[1]
    elif voxels.joined:  # blocks use one body
        del uses[BLOCK_CELLS]
    reached = dict(zip(uses, cells_reaching(solid, tuple(uses.values())), strict=True))
    return {
        level: min(
            (
                min(MAX_CELLS, _rounded_up(modules * number))
                for modules, cells in reached.items()
                if (number := cells[level]) is not None
            ),
            default=None,
        )
        for level in LEVELS
    }


def _rounded_up(count: int) -> int:
    """Return a number rounded up to two significant digits."""
    step = 10 ** max(0, len(str(count)) - 2)
    return -(-count // step) * step


def read_in_any_order(
    data: bytes, filename: str | None, options: PathOptions
) -> tuple[Content, PathOptions, tuple[str, ...]]:
    """Read a file; take a list of cells that is no path for a shape.

    Returns:
        The content, the options with which it was read, and notes.

    Raises:
        InputError: When the file cannot be used, or a wish cannot be wished for.
    """
    options.check()
    try:
        return read(data, filename=filename, as_voxels=options.as_voxels), options, ()
    except InputError as error:
        if error.code != "not-adjacent":
            raise
        note = (
            "The cells were read as a shape, not as a path, because some cells that follow each "
            "other are not neighbours."
        )
    shape = read(data, filename=filename, as_voxels=True)
    return shape, replace(options, as_voxels=True), (note,)


def prepare_in_any_order(
    data: bytes, filename: str | None, options: PathOptions, *, seed: int = 0
) -> Preparation:
    """Read a file with ``read_in_any_order`` and run ``prepare_subject``.

    For meshes, the numbers of modules that reach a likeness are estimated.

    Raises:
        InputError: See both.
    """
    shape, options, notes = read_in_any_order(data, filename, options)
    preparation = prepare_subject(shape, options, seed=seed, offering=True)
    return replace(preparation, notes=(*notes, *preparation.notes))


def check_for_table(chain: Chain) -> None:
    """Refuse a chain that cannot fold on a table.

    Raises:
        InputError: ``unsuited-world`` for modules that follow no paths, ``not-for-a-table`` for
            its path.
    """
    from foldback.planner.table_paths.rules import rule_violations

    if not chain.module.follows_paths:
        raise InputError(
            "unsuited-world",
            f"got a chain of {chain.module.words.plural} for a fold on a table, expected modules "
            "that fold along any path of cells; use the 'floating' world for others.",
            where="world",
        )
    faults = rule_violations(np.rint(chain.folded_poses.positions).astype(np.int64))
    if faults:
        fault_text = " ".join(fault.reason.text for fault in faults[:MAX_LISTED_VIOLATIONS])
        if further := len(faults[MAX_LISTED_VIOLATIONS:]):
            fault_text += f" The path has {further} more problem{'' if further == 1 else 's'}."
        raise InputError(
            "not-for-a-table",
            f"got a path along which a chain cannot fold on a table: {fault_text} "
            "Expected a path that rises layer by layer; read the cells as a shape to find such a "
            "path.",
            reasons=[fault.reason.as_dict() for fault in faults[:MAX_LISTED_VIOLATIONS]],
        )


def filling_of(options: PathOptions) -> FillingMethod:
    """Return the method by which cells become chains."""
    from foldback.planner.pathfinding.filling_methods import FILLING_METHODS
    from foldback.planner.table_paths.fill_table import TableCubes

    return TableCubes() if options.world == "table" else FILLING_METHODS[options.kind.filling]


def _prepared_chain(chain: Chain, options: PathOptions, kind: str) -> Preparation:
    notes = ()
    if options.modules is not None and options.modules != len(chain):
        notes = (
            f"The requested number of modules was ignored, because this {kind} has {len(chain)} "
            "modules.",
        )
    chain, not_started = starting_at(chain, options.start)
    return Preparation(
        kind=kind,
        name=chain.name,
        options=options,
        chains=(chain,),
        knot=knot_of(chain.folded_poses.positions),
        notes=notes,
        not_started=not_started,
    )


def _cells_alone(shape: Shape | Solid, options: PathOptions, seed: int) -> Preparation:
    if isinstance(shape, Shape):
        return Preparation(
            kind="voxels",
            name=shape.name,
            options=options,
            chains=(),
            shape=shape,
            notes=shape.notes,
        )
    from foldback.planner.pathfinding.shape_overlap import likeness_of
    from foldback.planner.shapes.voxelise import voxelise

    voxels = voxelise(shape, cells=filling_of(options).cells_for(options), seed=seed)
    placed = _in_cells(shape, voxels).moved(np.eye(3), 1.0, -0.5)
    return Preparation(
        kind="mesh",
        name=shape.name,
        options=options,
        chains=(),
        shape=voxels.shape,
        notes=(*shape.notes, *voxels.notes, *voxels.remarks),
        voxels=voxels,
        likenesses=(likeness_of(placed, voxels.shape.cells),),
    )


def _from_shape(
    kind: str, shape: Shape, options: PathOptions, seed: int, time_limit_s: float
) -> Preparation:
    from foldback.planner.pathfinding.shape_overlap import points_of_cells

    filled = filling_of(options).fill(
        shape, options, of_solid=False, seed=seed, time_limit_s=time_limit_s
    )
    exact = options.kind.follows_paths
    likenesses = _likenesses(points_of_cells(shape, exact=exact), filled)
    notes = (*shape.notes, *filled.notes)
    return _preparation(kind, shape.name, options, filled, notes, likenesses=likenesses)


def _from_drawing(
    drawing: Word | Picture,
    options: PathOptions,
    seed: int,
    time_limit_s: float,
    searching: bool,
) -> Preparation:
    from foldback.planner.pipeline.drawn_shape import drawn_shape

    filling = filling_of(options)
    modules = DEFAULT_DRAWN_MODULES if options.modules is None else options.modules
    drawn = drawn_shape(drawing, options, filling.cells_for(replace(options, modules=modules)))
    kind = "word" if isinstance(drawing, Word) else "picture"
    if not searching:
        alone = _cells_alone(drawn.shape, options, seed)
        return replace(alone, kind=kind, notes=drawn.notes)
    # Along loops through flat shapes, chains fold more reliably than in an order for peeling.
    in_loops = options.method == "auto" and options.world != "table"
    in_loops = in_loops and options.kind.follows_paths
    filled = filling.fill(
        drawn.shape,
        replace(options, method="blocks") if in_loops else options,
        of_solid=True,
        seed=seed,
        time_limit_s=time_limit_s,
    )
    likenesses = () if drawn.likeness is None else (drawn.likeness,) * len(filled.chains)
    return _preparation(
        kind,
        drawn.shape.name,
        options,
        filled,
        (*drawn.notes, *filled.notes),
        likenesses=likenesses,
    )


def _check_for_fitted(shape: Shape | Solid | Word | Picture, options: PathOptions) -> None:
    """Refuse the method 'fitted' where it chooses nothing."""
    if isinstance(shape, Word | Picture):
        problem, remedy = "a word or picture", "Use the method 'auto'."
    elif isinstance(shape, Shape):
        problem, remedy = "cells", "Use the method 'exact' or 'blocks', as the cells are given."
    elif options.world == "table":
        problem, remedy = "a fold on a table", "Use the method 'auto'."
    else:
        return
    raise InputError(
        "unsuited-method",
        f"got the method 'fitted' for {problem}, expected a mesh that is folded in zero gravity. "
        f"{remedy}",
        where="method",
    )


def _from_solid(solid: Solid, options: PathOptions, seed: int, time_limit_s: float) -> Preparation:
    """Return the better of a fitted path and the path through voxels; see ``MIN_FITTED_GAIN``.

    With the method ``exact`` a fitted path has exactly the requested number of modules. On a table
    the path is taken that should fold more easily. Modules that fill rings are always fitted, below
    ``LONG_CHAIN``: through any set of them that is chosen a trail leads.
    """
    if options.world == "table":
        voxelised = _voxelised(solid, options, seed, time_limit_s)
        may_fit = options.method == "auto" and _can_fit(options) and not options.repair
        return _easier_on_table(solid, voxelised, seed) if may_fit else voxelised
    if not _can_fit(options):
        return _voxelised(solid, options, seed, time_limit_s)
    if options.method != "auto" or not options.kind.follows_paths:
        return _fitted(solid, options, seed)
    from foldback.planner.shapes.voxelise import chooser_for

    # A requested start is a cell of the path that is chosen without it, as a preview shows it.
    anywhere = replace(options, start=None)
    chooser = chooser_for(solid, seed)
    voxelised = _voxelised(solid, anywhere, seed, time_limit_s, chooser=chooser, offering=False)
    fitted = _fitted(solid, anywhere, seed)
    if not _is_better(fitted, voxelised):
        return _voxelised(solid, options, seed, time_limit_s, chooser=chooser)
    if options.start is not None:
        return _fitted(solid, options, seed)
    return _with_first_of(fitted, voxelised)


def _with_first_of(preferred: Preparation, alternative: Preparation) -> Preparation:
    """Return a preparation with the first chain of another one as its last."""
    return replace(
        preferred,
        chains=(*preferred.chains, *alternative.chains[:1]),
        likenesses=(*preferred.likenesses, *alternative.likenesses[: len(alternative.chains[:1])]),
    )


def _can_fit(options: PathOptions) -> bool:
    """Return True if the cells of a mesh can be chosen together with the path."""
    if options.method not in ("auto", "exact"):
        return options.method == "fitted"
    modules = DEFAULT_MODULES if options.modules is None else options.modules
    is_suited = options.kind.follows_paths or options.method == "auto"
    return is_suited and modules < LONG_CHAIN


def _has_first_result(options: PathOptions) -> bool:
    """Return True if a fit of a path to a mesh has a first result worth showing."""
    plain = options.world != "table" and options.method != "exact" and options.start is None
    return plain and options.kind.follows_paths and _can_fit(options)


def _easier_on_table(solid: Solid, voxelised: Preparation, seed: int) -> Preparation:
    """Return a fitted path for a table, or the one through voxels if its cost is lower.

    The cost counts the difficulty of the fold and the likeness (``fit_table.cost_of``).
    """
    from foldback.planner.path_fit.fill_fitted import fill_for_table
    from foldback.planner.path_fit.fit_table import MIN_IOU_SHARE, cost_of

    filling = fill_for_table(solid, voxelised.options, seed=seed)
    if filling is None:
        return voxelised
    voxels, filled = filling
    notes = (*voxels.notes, *solid.notes, *filled.notes)
    fitted = _of_solid(solid, voxelised.options, voxels, filled, notes)
    if fitted.likeness is None or voxelised.likeness is None or not voxelised.chains:
        return fitted
    is_alike = voxelised.likeness.iou >= MIN_IOU_SHARE * fitted.likeness.iou
    cost = cost_of(fitted.cells, fitted.likeness.iou)
    is_easier = cost_of(voxelised.cells, voxelised.likeness.iou) < cost
    return voxelised if is_alike and is_easier else _with_first_of(fitted, voxelised)


def _is_better(fitted: Preparation, voxelised: Preparation) -> bool:
    """Return True if a fitted path is clearly more like the solid, with the requested ends."""
    if not voxelised.chains or voxelised.likeness is None:
        return True
    if fitted.likeness is None or fitted.not_started:
        return False
    gain = fitted.likeness.iou - voxelised.likeness.iou
    return gain >= (0.0 if _keeps_parts(fitted) > _keeps_parts(voxelised) else MIN_FITTED_GAIN)


def _keeps_parts(preparation: Preparation) -> bool:
    return preparation.voxels is not None and preparation.voxels.retention.parts


def _fitted(solid: Solid, options: PathOptions, seed: int, *, quick: bool = False) -> Preparation:
    from foldback.planner.path_fit.fill_fitted import fill_fitted
    from foldback.planner.path_fit.fill_trail import fill_with_trail

    if options.kind.follows_paths:
        voxels, filled = fill_fitted(solid, options, seed=seed, quick=quick)
    else:
        voxels, filled = fill_with_trail(solid, options, seed=seed)
    notes = (*voxels.notes, *solid.notes)
    return replace(_of_solid(solid, options, voxels, filled, notes), final=not quick)


def _voxelised(
    solid: Solid,
    options: PathOptions,
    seed: int,
    time_limit_s: float,
    *,
    chooser: Chooser | None = None,
    offering: bool = True,
) -> Preparation:
    from foldback.planner.shapes.voxelise import chooser_for, voxels_for

    filling = filling_of(options)
    chooser = chooser_for(solid, seed) if chooser is None else chooser
    voxels = voxels_for(chooser, filling.cells_for(options), offering=offering)
    filled = filling.fill(
        voxels.shape, options, of_solid=True, seed=seed, time_limit_s=time_limit_s
    )
    notes = (*voxels.notes, *solid.notes, *voxels.remarks, *filled.notes)
    return _of_solid(solid, options, voxels, filled, notes)


def _of_solid(
    solid: Solid,
    options: PathOptions,
    voxels: Voxels,
    filled: FilledShape,
    notes: tuple[str, ...],
) -> Preparation:
    likenesses = _likenesses(_in_cells(solid, voxels), filled)
    return _preparation(
        "mesh",
        solid.name,
        options,
        filled,
        notes,
        solid=solid,
        voxels=voxels,
        likenesses=likenesses,
    )


def _in_cells(solid: Solid, voxels: Voxels) -> InsidePoints:
    """Return points of the whole solid in the space of its cells; c reaches from c to c + 1."""
    from foldback.planner.shapes.inside_points import inside_points

    return inside_points(solid).moved(voxels.rotation, 1.0 / voxels.pitch, voxels.offset)


def _likenesses(points: InsidePoints, filled: FilledShape) -> tuple[Likeness, ...]:
    """Return the likeness of each chain to the input, given by points in the cells' space.

    Without a chain it is that of one module in each cell; empty for modules that fill rings.
    """
    from foldback.planner.pathfinding.shape_overlap import likeness_of

    placed = points.moved(filled.turn, filled.scale, filled.shift)
    if not filled.chains:
        return () if filled.method == "rings" else (likeness_of(placed, filled.shape.cells),)
    likenesses: dict[bytes, Likeness] = {}
    for chain in filled.chains:
        if (key := _places(chain)) not in likenesses:
            likenesses[key] = likeness_of(placed, chain)
    return tuple(likenesses[_places(chain)] for chain in filled.chains)


def _places(chain: Chain) -> bytes:
    """Return a key that is the same for chains whose folded modules lie in the same places."""
    twice = np.rint(2.0 * chain.folded_poses.positions).astype(np.int64)
    return twice[np.lexsort(twice.T)].tobytes()


def _preparation(
    kind: str,
    name: str,
    options: PathOptions,
    filled: FilledShape,
    notes: tuple[str, ...],
    **fields: Any,
) -> Preparation:
    return Preparation(
        kind=kind,
        name=name,
        options=options,
        chains=filled.chains,
        shape=filled.shape,
        method=filled.method,
        feasibility=filled.feasibility,
        knot=filled.knot,
        notes=notes,
        not_started=filled.not_started,
        filled=filled,
        **fields,
    )


def _feasibility(state: Feasibility, shape: Shape) -> dict[str, Any]:
    from foldback.planner.pathfinding.fill_cubes import modules_after

    return {
        "feasible": state.feasible,
        "problems": [
            {
                **problem.reason.as_dict(),
                "detail": problem.reason.text,
                "cells": [list(map(int, cell)) for cell in problem.cells],
            }
            for problem in state.problems
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
