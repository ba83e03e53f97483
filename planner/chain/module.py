"""Modules: one polyhedron with its joint frames. Geometry is data, not code."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final, Literal, TypeVar

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.core.structures import Hull, Joint
from foldback.planner.errors import InputError

DEFAULT_MODULE_SIZE: Final = 0.95
"""Default size at which the clearance of modules is checked, as a fraction of the pitch."""
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
RELIEF_SAMPLES: Final = 64
"""Number of points along each side of a module at which its relief is sampled (material that must
be removed so that linked modules can turn), to compute its volume."""
IndexT = TypeVar("IndexT", int, Ints)


def _frozen(values: object) -> Array:
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


def _largest_projection(along: Array, across: Array, limit: float) -> Array:
    """Return the largest of along · cos t + across · sin t over all |t| ≤ limit."""
    bent = along * np.cos(limit) + np.abs(across) * np.sin(limit)
    within = np.arctan2(np.abs(across), along) <= limit
    return np.where(within, np.hypot(along, across), bent)


@dataclass(frozen=True, kw_only=True, eq=False)
class Module:
    """One kind of module and the joint that ties it to the next.

    The pose of module ``i + 1`` follows from that of module ``i`` (lengths in pitches):

        T[i+1] = T[i] · Trans(anchor) · Rot(axis_1, q_1) … Rot(axis_K, q_K) · turn · Trans(offset)

    Attributes:
        name: ``cube`` or ``tetrahedron``.
        vertices: (V, 3) corners of the full-size hull, in the module's frame.
        face_normals: (A, 3) unit normals of the hull's faces, one of each parallel pair.
        edge_directions: (E, 3) unit directions of the hull's edges, one of each parallel set.
        anchor: (3,) centre of the outgoing joint in this module's frame.
        axes: (K, 3) hinge axes of the joint, outermost (nearest this module) first.
        turn: (3, 3) fixed rotation from the joint's frame to the next module's frame.
        offset: (3,) centre of the next module seen from the joint, in the next module's frame.
        hinge_names: K suffixes for the hinges, in the order of ``axes``.
        rigid_links: Number of links at the start of a chain without a joint.
        angle_limit_rad: Maximum angle of each hinge, either way.
        stop_rad: Angle of the stops of a simulated explosion; they give a little, and recorded
            angles are to stay within the limit.
        volume: Volume of the full-size hull, in cubic pitches.
        inertia: (3,) principal moments of the full-size hull with mass 1, along the frame's axes.
        apart: Modules fewer links apart than this may lie in one another by the joint's nature.
        fills_cell: True if a folded module fills one cell of the cubic lattice.
        geom: Shape of the hull in simulations: ``box`` or the convex ``mesh`` of its corners.
    """

    name: str
    vertices: Array
    face_normals: Array
    edge_directions: Array
    anchor: Array
    axes: Array
    turn: Array
    offset: Array
    hinge_names: tuple[str, ...]
    rigid_links: int
    angle_limit_rad: float
    stop_rad: float
    volume: float
    inertia: Array
    apart: int
    fills_cell: bool
    geom: Literal["box", "mesh"]

    @cached_property
    def inner_radius(self) -> float:
        """Radius of the ball about the centre that fits into the hull, in pitches."""
        reach = self.vertices @ self.face_normals.T
        return float(np.minimum(reach.max(axis=0), -reach.min(axis=0)).min())

    @cached_property
    def joint(self) -> Joint:
        """The joint as kernels take it."""
        return Joint(self.rigid_links, self.anchor, self.axes, self.turn, self.offset)

    @cached_property
    def hull(self) -> Hull:
        """The hull as kernels take it."""
        counts = len(self.vertices), len(self.face_normals), len(self.edge_directions)
        return Hull(
            vertices=self.vertices,
            normals=self.face_normals,
            edges=self.edge_directions,
            parts=np.array([[end for count in counts for end in (0, count)]], dtype=np.int64),
            pieces=np.array([[0, 1]], dtype=np.int64),
            kinds=np.zeros(1, dtype=np.int64),
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

    @cached_property
    def radius(self) -> float:
        """Distance from the centre to the farthest corner, in pitches."""
        return float(np.linalg.norm(self.vertices, axis=1).max())

    def exempt_pairs(self, modules: int) -> tuple[tuple[int, int], ...]:
        """The pairs of a chain of so many modules that may lie in one another, (i, j) with i < j.

        No check looks at them: two cubes that share a joint overlap while it turns.
        """
        return tuple(
            (j - k, j) for j in range(modules) for k in range(min(self.apart - 1, j), 0, -1)
        )

    def near_face(self, module_size: float) -> float:
        """Return the distance of the next module's near face from the joint, in pitches.

        Args:
            module_size: Module size as a fraction of the pitch.
        """
        distance = float(np.linalg.norm(self.offset))
        return distance + module_size * float((self.vertices @ self.offset).min()) / distance

    def relief_radius(self, module_size: float) -> float | None:
        """Return the largest ``reach`` of the points of a real module, in pitches.

        Points that reach farther would lie in the next module at some angles of the joint. None
        if linked modules are checked like all others, so that no volume has to be cut away.

        Args:
            module_size: Module size as a fraction of the pitch.
        """
        return self.near_face(module_size) if self.apart > 1 else None

    def relief_share(self, module_size: float) -> float:
        """Return the fraction of its volume that a real module lacks by ``relief_radius``.

        Args:
            module_size: Module size as a fraction of the pitch.
        """
        return _relief_share(self, float(module_size))

    def reach(self, points: Array) -> Array:
        """Return the reach of points from the joint over all directions of the next module.

        In front of the joint that is their distance from it, behind it that from the line of the
        link, and more there by what the joint turns beyond a right angle.

        Args:
            points: (P, 3) in the module's frame, in pitches.

        Returns:
            (P,): the largest p · d over all directions d of the joint's range.
        """
        if self.hinges_per_joint != 2:
            raise ValueError(f"got a {self.name}, expected a module with universal joints")
        # d = R(axis_1, a) R(axis_2, b) n, and the three directions are at right angles.
        outward = self.turn @ self.offset
        outward = outward / np.linalg.norm(outward)
        p = points - self.anchor
        along, sideways, up = p @ outward, p @ np.cross(self.axes[0], outward), p @ self.axes[0]
        limit = self.angle_limit_rad
        farthest = _largest_projection(along, sideways, limit)
        nearest = -_largest_projection(-along, sideways, limit)
        return np.maximum(
            _largest_projection(farthest, up, limit), _largest_projection(nearest, up, limit)
        )

    def joint_names(self, modules: int) -> tuple[str, ...]:
        """Names of the hinge angles, module by module: ``joint_<module>[_<hinge>]``."""
        return tuple(
            f"joint_{module}_{hinge}" if hinge else f"joint_{module}"
            for module in range(self.rigid_links, modules - 1)
            for hinge in self.hinge_names
        )


@lru_cache(maxsize=64)
def _relief_share(module: Module, module_size: float) -> float:
    radius = module.relief_radius(module_size)
    if radius is None:
        return 0.0
    hull = module.vertices * module_size
    sides = [
        low + (np.arange(RELIEF_SAMPLES) + 0.5) * (high - low) / RELIEF_SAMPLES
        for low, high in zip(hull.min(axis=0), hull.max(axis=0), strict=True)
    ]
    points = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    extents = (hull @ module.face_normals.T).max(axis=0)
    points = points[(np.abs(points @ module.face_normals.T) <= extents).all(axis=1)]
    return round(float((module.reach(points) > radius).mean()), 3)


CUBE: Final = Module(
    name="cube",
    vertices=_frozen([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]),
    face_normals=_frozen(np.eye(3)),
    edge_directions=_frozen(np.eye(3)),
    anchor=_frozen([0.0, 0.0, 0.0]),
    axes=_frozen([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]),
    turn=_frozen(np.eye(3)),
    offset=_frozen([1.0, 0.0, 0.0]),
    hinge_names=("z", "y"),
    rigid_links=1,
    angle_limit_rad=float(np.deg2rad(92.0)),
    stop_rad=float(np.deg2rad(92.0)),
    volume=1.0,
    inertia=_frozen([1.0 / 6.0, 1.0 / 6.0, 1.0 / 6.0]),
    apart=2,
    fills_cell=True,
    geom="box",
)
"""Cubic module: a universal joint (hinge about z, then about y) at each cube's centre, and links of
one pitch to the next cube."""

_SIDE: Final = np.sqrt(0.5)
_SLANT: Final = np.sqrt(1.0 / 3.0)
TETRAHEDRON: Final = Module(
    name="tetrahedron",
    vertices=_frozen([(-0.5, -1, 0), (-0.5, 1, 0), (0.5, 0, -1), (0.5, 0, 1)]),
    face_normals=_frozen(
        [(-_SIDE, 0, _SIDE), (-_SIDE, 0, -_SIDE), (_SIDE, _SIDE, 0), (_SIDE, -_SIDE, 0)]
    ),
    edge_directions=_frozen(
        [
            (0, 1, 0),
            (0, 0, 1),
            *((_SLANT, y, z) for y in (-_SLANT, _SLANT) for z in (-_SLANT, _SLANT)),
        ]
    ),
    anchor=_frozen([0.5, 0.0, 0.0]),
    axes=_frozen([[0.0, 0.0, 1.0]]),
    turn=_frozen([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]),
    offset=_frozen([0.5, 0.0, 0.0]),
    hinge_names=("",),
    rigid_links=0,
    angle_limit_rad=float(np.deg2rad(90.85)),
    stop_rad=float(np.deg2rad(90.25)),
    volume=2.0 / 3.0,
    inertia=_frozen([0.2, 0.15, 0.15]),
    apart=1,
    fills_cell=False,
    geom="mesh",
)
"""Tetrahedral module (right-angle tetrahedron, or tetragonal disphenoid), hinged to its neighbours
along its two long edges of two pitches; the other edges have √3 pitches. The middles of its hinges
are one pitch apart. Neighbours lie face to face at ±90°, so a hinge turns hardly farther."""

MODULES: Final[dict[str, Module]] = {module.name: module for module in (CUBE, TETRAHEDRON)}


def module_named(name: str) -> Module:
    """The module of that name.

    Raises:
        InputError: ``unknown-module`` when there is none.
    """
    try:
        return MODULES[name]
    except KeyError:
        known_names = ", ".join(sorted(MODULES))
        raise InputError(
            "unknown-module", f"got the module type {name!r}, expected one of: {known_names}."
        ) from None
