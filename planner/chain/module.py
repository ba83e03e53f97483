"""Modules: rigid pieces with their joints. Geometry is data, not code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, Final, Literal, NamedTuple, TypeVar

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.polyhedron import Polyhedron, frozen
from foldback.planner.chain.rotations import axis_rotation
from foldback.planner.core.structures import Hull, Joint

DEFAULT_MODULE_SIZE: Final = 0.95
"""Default size at which the clearance of modules is checked, as a fraction of the pitch."""
TWIST_MODULE_SIZE: Final = 0.8
"""The same for modules whose joints turn freely in steps. Of 60 figures of the snake all fold at
it, and 33 at 0.9: docs/decisions/0066-turns-by-steps.md."""
ALUMINIUM_KG_M3: Final = 2700.0
"""Density of aluminium, in kg/m³."""
DEFAULT_DENSITY_KG_M3: Final = ALUMINIUM_KG_M3
"""Default density of a module, which is solid, in kg/m³: that of the paper."""
LONG_CHAIN: Final = 600
"""Minimum number of modules for which a chain gets a path whose cells can be removed one after the
other from one end. Such a chain can be unfolded by peeling: released from its end, group by group.
Decision 0013."""
MAX_SMOOTH_CURVE_MODULES: Final = 1500
"""Maximum number of modules of a chain whose recorded motion is played back along a smooth curve,
which takes gigabytes for longer chains. Their motion is played back frame by frame, and its
simulation stops hinges 0.01 rad earlier, as no curve corrects angles beyond a joint's range."""
MAX_FREE_TURN_RAD: Final = 1.99 * np.pi
"""Largest recorded angle of a hinge without stops, either way, rad: a little less than the turn up
to which plans hold angles as whole steps of 32 bits."""
IndexT = TypeVar("IndexT", int, Ints)


@dataclass(frozen=True)
class ModuleWords:
    """Words by which people call a module.

    Attributes:
        singular: Of one module, for example "cube".
        plural: Of several, for example "cubes".
    """

    singular: str
    plural: str

    def counted(self, count: int) -> str:
        """Return a number of modules, for example "1 cube"."""
        return f"{count} {self.singular if count == 1 else self.plural}"


Filling = Literal["cells", "rings", "half-cells"]
"""How folded modules fill space: one cube in each cell of the cubic lattice (``cells``), rings of
six tetrahedra in each cell (``rings``), or two prisms in each cell (``half-cells``)."""


JointKind = Literal["hinge", "twist", "universal"]
"""Kinds of joints: a hinge, a twist about the link, or two hinges at right angles."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Piece:
    """A rigid body of a chain and the joint behind it, in a frame at its centre of mass.

    The axes of the frame are principal axes of inertia. Lengths are in pitches.

    Attributes:
        name: Name within its module.
        parts: Convex bodies that it consists of.
        volume: Volume of the parts, in cubic pitches.
        inertia: (3,) principal moments with mass 1, along the frame's axes.
        entry: (3,) centre of the joint before it.
        entry_axes: (3, 3) axes of the frame of that joint, as columns, at angle zero.
        exit: (3,) centre of the joint behind it.
        exit_axes: (3, 3) axes of the frame of that joint, as columns.
        joint_kind: ``hinge``, ``twist`` or ``universal``.
        axes: (K, 3) hinge axes of the joint behind it, outermost (nearest this piece) first.
        ranges_rad: (K, 2) smallest and largest angle of each hinge, infinite if it turns freely.
        stops_rad: (K, 2) angles of the stops of a simulated explosion; they give a little, and
            recorded angles are to stay within the ranges.
        step_rad: Angle by which the joint turns in one step, or None.
    """

    name: str
    parts: tuple[Polyhedron, ...]
    volume: float
    inertia: Array
    entry: Array
    entry_axes: Array
    exit: Array
    exit_axes: Array
    joint_kind: JointKind
    axes: Array
    ranges_rad: Array
    stops_rad: Array
    step_rad: float | None

    @cached_property
    def corners(self) -> Array:
        """(V, 3) corners of all parts."""
        return frozen(np.concatenate([part.corners for part in self.parts]))

    @cached_property
    def radius(self) -> float:
        """Distance from the centre to the farthest corner, in pitches."""
        return float(np.linalg.norm(self.corners, axis=1).max())

    @cached_property
    def inner_radius(self) -> float:
        """Radius of the largest ball about the centre within one part, in pitches; 0 for none."""
        return max(0.0, *(_inner_radius(part) for part in self.parts))

    @cached_property
    def is_box(self) -> bool:
        """True for one box along the axes of the frame, about its centre."""
        part = self.parts[0]
        return (
            len(self.parts) == 1
            and len(part.corners) == 8
            and np.array_equal(np.abs(part.corners), np.abs(part.corners[:1]).repeat(8, axis=0))
            and np.array_equal(part.face_normals, np.eye(3))
        )


def _inner_radius(part: Polyhedron) -> float:
    heights = part.corners @ part.face_normals.T
    return float(np.minimum(heights.max(axis=0), -heights.min(axis=0)).min())


class Link(NamedTuple):
    """Link between two modules of a chain; see ``Module``.

    Attributes:
        anchor: (3,) centre of the joint in the frame of the module before it.
        axes: (K, 3) hinge axes, outermost first, in that frame.
        turn: (3, 3) fixed rotation from the joint's frame to the next module's frame.
        offset: (3,) centre of the next module seen from the joint, in the next module's frame.
    """

    anchor: Array
    axes: Array
    turn: Array
    offset: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Module:
    """One kind of module: its pieces and how they follow each other in a chain.

    Module ``i`` of a chain is the piece ``pattern[i % len(pattern)]``. The pose of module ``i + 1``
    follows from that of module ``i`` (lengths in pitches), with the anchor, axes, turn and offset
    of the link between their pieces:

        T[i+1] = T[i] · Trans(anchor) · Rot(axis_1, q_1) … Rot(axis_K, q_K) · turn · Trans(offset)

    The anchor is the exit of the piece before, the offset minus the entry of the piece behind, and
    the turn lays the entry's axes over the exit's.

    Attributes:
        name: Name for programs, for example ``cube``.
        words: What people call it.
        filling: How folded modules fill space; None if they do not.
        pieces: Its kinds of pieces.
        pattern: Piece of each module of a period.
        rest_rad: (period,) angle of the joint behind each module of a period in the rest shape,
            at which hinge angles are zero; None if each is zero.
        hinge_names: K suffixes for the hinges of a joint, in the order of their axes.
        rigid_links: Number of links at the start of a chain without a joint.
        apart: Modules fewer links apart than this may lie in one another by the joint's nature.
        mass_kg, torque_nm, speed_rad_s, pitch_m: Of the real robot, where known.
        colours: Colours of successive modules in pictures without other colours, in turn.
        document: The ``foldback-module/1`` file that describes it.
    """

    name: str
    words: ModuleWords
    filling: Filling | None
    pieces: tuple[Piece, ...]
    pattern: tuple[int, ...]
    rest_rad: Array | None
    hinge_names: tuple[str, ...]
    rigid_links: int
    apart: int
    mass_kg: float | None
    torque_nm: float | None
    speed_rad_s: float | None
    pitch_m: float | None
    colours: tuple[str, ...]
    document: dict[str, Any]

    def piece(self, module: int) -> Piece:
        """Return the piece of a module of a chain."""
        return self.pieces[self.pattern[module % len(self.pattern)]]

    @cached_property
    def piece_numbers(self) -> Ints:
        """(period,) numbers of the pieces of a period."""
        return np.array(self.pattern, dtype=np.int64)

    def link(self, module: int) -> Link:
        """Return the link between a module of a chain and the next one."""
        row = self.joint.row(module)
        return Link(*(column[row] for column in self.joint[3:]))

    def _link(self, module: int) -> Link:
        before, behind = self.piece(module), self.piece(module + 1)
        turn = before.exit_axes @ behind.entry_axes.T
        if self.rest_rad is not None:
            rest = float(self.rest_rad[module % len(self.pattern)])
            turn = axis_rotation(before.axes[0], rest) @ turn
        return Link(before.exit, before.axes, frozen(turn + 0.0), frozen(0.0 - behind.entry))

    @cached_property
    def ranges_rad(self) -> Array:
        """(period, K, 2) range of each hinge of a period, infinite where it turns freely."""
        rest = np.zeros(len(self.pattern)) if self.rest_rad is None else self.rest_rad
        ranges = np.array([self.pieces[k].ranges_rad for k in self.pattern])
        return frozen(ranges - rest[:, None, None])

    @cached_property
    def longest_link(self) -> float:
        """Longest way from a module's centre by a joint to the next one's, in pitches."""
        anchors, offsets = (
            np.linalg.norm(ends, axis=1) for ends in (self.joint.anchor, self.joint.offset)
        )
        return float((anchors + offsets).max())

    @cached_property
    def largest_angle_rad(self) -> float:
        """Largest angle of any hinge, either way."""
        return float(np.abs(self.stops_behind(np.arange(len(self.pattern)))).max())

    @cached_property
    def stops_early_rad(self) -> float:
        """Angle before the ends of their ranges at which hinges stop in a simulated explosion."""
        ends = [np.nan_to_num(p.ranges_rad) - np.nan_to_num(p.stops_rad) for p in self.pieces]
        return float(np.abs(ends).max())

    def ranges_behind(self, modules: IndexT) -> Array:
        """Return (…, K, 2) ranges of the hinges behind modules; infinite for those without one."""
        return self.ranges_rad[modules % len(self.pattern)]

    def stops_behind(self, modules: IndexT) -> Array:
        """Return (…, K, 2) angles at which motions of the hinges behind modules stop.

        Hinges without a range have angles, too, that no motion exceeds.
        """
        return np.clip(self.ranges_behind(modules), -MAX_FREE_TURN_RAD, MAX_FREE_TURN_RAD)

    @property
    def default_size(self) -> float:
        """Size at which clearance is checked if no other one is asked for."""
        return TWIST_MODULE_SIZE if self.turns_freely_in_steps else DEFAULT_MODULE_SIZE

    @property
    def has_steps(self) -> bool:
        """True if all joints turn in steps."""
        return all(piece.step_rad is not None for piece in self.pieces)

    @property
    def turns_freely_in_steps(self) -> bool:
        """True if all joints turn in steps, and without a stop."""
        return self.has_steps and bool(np.isinf(self.ranges_rad).all())

    @cached_property
    def volume(self) -> float:
        """Mean volume of a period's pieces, in cubic pitches."""
        return float(np.mean([self.pieces[k].volume for k in self.pattern]))

    def masses(self, modules: int, first: int = 0) -> Array:
        """Return the (modules,) masses of a chain's modules from ``first`` on.

        In mean masses of a period.
        """
        volumes = np.array([piece.volume for piece in self.pieces]) / self.volume
        return volumes[self.piece_numbers[(first + np.arange(modules)) % len(self.pattern)]]

    @cached_property
    def radius(self) -> float:
        """Distance from the centre of any piece to its farthest corner, in pitches."""
        return max(piece.radius for piece in self.pieces)

    @cached_property
    def inner_radius(self) -> float:
        """Radius of the ball about its centre that fits into each piece, in pitches."""
        return min(piece.inner_radius for piece in self.pieces)

    @cached_property
    def face_distance(self) -> float:
        """Largest distance of a face's plane from the centre of its piece, in pitches."""
        return max(
            float((part.corners @ normal).max())
            for piece in self.pieces
            for part in piece.parts
            for normal, _ in part.faces
        )

    @property
    def fills_cell(self) -> bool:
        """True if a folded module fills one cell of the cubic lattice."""
        return self.filling == "cells"

    @cached_property
    def follows_paths(self) -> bool:
        """True if a chain of it can follow each path through the cells of the cubic lattice.

        Such a module fills a cell. The joint at its centre turns a quarter about z, then about y.
        """
        quarter = np.pi / 2
        anchor, axes, turn, offset = self.link(0)
        return (
            self.fills_cell
            and len(self.pieces) == 1
            and self.rigid_links == 1
            and self.has_universal_joints
            and not anchor.any()
            and np.array_equal(axes, np.eye(3)[[2, 1]])
            and np.array_equal(turn, np.eye(3))
            and np.array_equal(offset, np.eye(3)[0])
            and bool((np.abs(self.ranges_rad) >= quarter).all())
        )

    @cached_property
    def has_universal_joints(self) -> bool:
        """True if each joint has two hinges at right angles to each other and to the link."""
        if self.hinges_per_joint != 2:
            return False
        links = [self.link(module) for module in range(len(self.pattern))]
        frames = [[*link.axes, link.turn @ link.offset] for link in links]
        return all(
            abs(float(a @ b)) < 1e-9  # cosine of a right angle, but for rounding
            for axes in frames
            for a, b in combinations(axes, 2)
        )

    @cached_property
    def joint(self) -> Joint:
        """The joints as kernels take them: a row for each kind of link."""
        kinds, first = self._link_kinds
        links = [self._link(module) for module in first.tolist()]
        columns = (frozen(column) for column in zip(*links, strict=True))
        return Joint(self.rigid_links, 0, kinds, *columns)

    @cached_property
    def moments(self) -> Array:
        """(T, 3) ``inertia`` of the module before each of the rows of ``joint``."""
        return frozen([self.piece(module).inertia for module in self.joint_holders.tolist()])

    @property
    def joint_holders(self) -> Ints:
        """(T,) first module of a chain before each of the rows of ``joint``."""
        return self._link_kinds[1]

    @cached_property
    def _link_kinds(self) -> tuple[Ints, Ints]:
        """(period,) kind of the link behind each module of a period, and the first of each kind."""
        pattern = self.piece_numbers
        rest = np.zeros(len(pattern)) if self.rest_rad is None else self.rest_rad
        links = np.stack([pattern, np.roll(pattern, -1), rest], axis=1)
        _, first, kinds = np.unique(links, axis=0, return_index=True, return_inverse=True)
        return kinds.reshape(-1).astype(np.int64), first

    @cached_property
    def hull(self) -> Hull:
        """The hull as kernels take it."""
        parts = [part for piece in self.pieces for part in piece.parts]
        arrays = [(p.corners, p.face_normals, p.edge_directions) for p in parts]
        vertices, normals, edges = (np.concatenate(column) for column in zip(*arrays, strict=True))
        ends = np.cumsum([[0, 0, 0], *([len(a) for a in rows] for rows in arrays)], axis=0)
        first = np.cumsum([0, *(len(piece.parts) for piece in self.pieces)])
        return Hull(
            vertices=frozen(vertices),
            normals=frozen(normals),
            edges=frozen(edges),
            parts=np.stack([ends[:-1], ends[1:]], axis=2).reshape(-1, 6),
            pieces=np.stack([first[:-1], first[1:]], axis=1),
            kinds=self.piece_numbers,
            first=0,
            radius=self.radius,
        )

    @property
    def hinges_per_joint(self) -> int:
        """K, the number of hinges of one joint."""
        return len(self.hinge_names)

    def module_count(self, hinges: int) -> int:
        """Return the number of modules of a chain with so many hinges."""
        return hinges // self.hinges_per_joint + 1 + self.rigid_links

    def module_before(self, hinge: IndexT) -> IndexT:
        """Return the module on the near side of a hinge, of one or of each of an array."""
        return hinge // self.hinges_per_joint + self.rigid_links

    def module_after(self, hinge: IndexT) -> IndexT:
        """Return the module on the far side of a hinge, of one or of each of an array."""
        return self.module_before(hinge) + 1

    def hinges_of(self, joint: int | Ints) -> Ints:
        """Return the (…, K) hinges of a joint, or of each of an array of joints."""
        return np.expand_dims(joint, -1) * self.hinges_per_joint + np.arange(self.hinges_per_joint)

    def joint_after(self, module: IndexT) -> IndexT:
        """Return the joint between a module and the next; negative if that link is rigid."""
        return module - self.rigid_links

    def exempt_pairs(self, modules: int) -> tuple[tuple[int, int], ...]:
        """The pairs of a chain of so many modules that may lie in one another, (i, j) with i < j.

        No check looks at them: two cubes that share a joint overlap while it turns.
        """
        return tuple(
            (j - k, j) for j in range(modules) for k in range(min(self.apart - 1, j), 0, -1)
        )

    def joint_names(self, modules: int) -> tuple[str, ...]:
        """Names of the hinge angles, module by module: ``joint_<module>[_<hinge>]``."""
        return tuple(
            f"joint_{module}_{hinge}" if hinge else f"joint_{module}"
            for module in range(self.rigid_links, modules - 1)
            for hinge in self.hinge_names
        )
