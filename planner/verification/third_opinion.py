"""Third opinions: a plan's motion, looked at by other people's continuous collision detection.

The IPC Toolkit (ipctk) decides whether triangle meshes touch while their vertices move straight.
Modules turn, so each interval between two frames is divided until no vertex is farther than a
tolerance from where straight motion puts it:

- Positions are seen from the middle module, which halves the arms on which modules turn.
- Seen from there, the fifth derivative of a vertex is at most S^5 (L + r): S is the angle that all
  hinges between turn by, L the length of the links between, r the module's radius
  (`foldback_check.py` derives this). The deviation is measured at three moments of each part, and
  a polynomial through them, with 0 at both ends, is nowhere more than `SPREAD` times the largest.
  Interpolation adds at most `REMAINDER` S^5 (L + r).

So the bound holds at all moments, and not only at those measured. If the meshes stay farther apart
than a distance, the modules stay farther apart than it less twice the deviation.
"""

from __future__ import annotations

import importlib
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from foldback import foldback_check
from foldback.planner.arrays import Array, Ints
from foldback.planner.errors import UNREADABLE, InputError
from foldback.planner.plan.value_differences import Differences

STEPS_PER_PART: Final = 4
"""Number of equal time steps of each piece of a motion in which the IPC Toolkit lets all corners of
modules move straight. The distance from the real, curved motion is measured at the 3 moments
between the steps."""
SPREAD: Final = 1.87
"""Ratio of the largest deviation of a curved motion from a straight one anywhere in a piece of it
to the largest of the three measured, for a polynomial of degree 4: largest sum of the absolute
Lagrange polynomials of the three inner ones of five equidistant nodes, rounded up. Computed."""
REMAINDER: Final = 3.0e-5
"""Interpolation error, per unit of the fifth derivative, of the polynomial through five equidistant
nodes of [0, 1]: the largest product of distances from them, divided by 5!, rounded up. It is added
to the deviation of the motion that the IPC Toolkit checks from the real one. Computed."""
IPCTK_MISSING: Final = (
    "The IPC Toolkit (package ipctk) is not installed; install it with "
    "pip install 'foldback[ipctk]'."
)
"""Error if the optional package is missing."""

Indices = NDArray[np.int32]
Pair = tuple[int, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """Moment in frames at which modules come too close, and the pair, or None if none was found."""

    frame: float
    modules: Pair | None

    @property
    def words(self) -> str:
        """Plain English for the contact."""
        pair = "modules" if self.modules is None else "modules {} and {}".format(*self.modules)
        return f"{pair} come too close to each other at frame {self.frame:.3f}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Opinion:
    """Result of another program.

    Attributes:
        program: Name and version.
        intervals: Intervals between frames that it looked at.
        parts: Parts into which they were divided.
        clearance: Clearance that holds for the motion if there are no contacts, in pitches.
        deviation: Largest bound of the deviation of straight motion, in pitches.
        contacts: First contact of each interval that has one.
        seconds: Wall time.
    """

    program: str
    intervals: int
    parts: int
    clearance: float
    deviation: float
    contacts: tuple[Contact, ...]
    seconds: float

    @property
    def words(self) -> str:
        """Plain English for what was looked at."""
        return (
            f"{self.program} finds no modules within {self.clearance:.4f} pitches of each other "
            f"({self.intervals} intervals between frames were checked as {self.parts} straight "
            f"motions; these differ from the plan by at most {self.deviation:.1g} pitches; the "
            f"check took {self.seconds:.1f} s)"
        )

    @property
    def problems(self) -> Differences:
        """Plain English for its contacts."""
        limit = self.clearance + 2.0 * self.deviation
        for contact in self.contacts:
            yield (
                f"plan.npz: {self.program}: {contact.words}; expected a distance of more than "
                f"{limit:.4f} pitches"
            )


@dataclass(frozen=True, slots=True)
class Mesh:
    """Triangles of all modules, and pairs of vertices that need not stay apart."""

    faces: Indices
    edges: Indices
    exempt: Indices


def parts_of(plan: foldback_check.Plan) -> list[list[Array]]:
    """Return the corners of the parts of each module of a plan."""
    module = plan.module
    kinds = np.resize(module.piece, plan.count).tolist()
    corners = [[part.corners for part in piece] for piece in module.pieces]
    return [corners[kind] for kind in kinds]


def starts_of(modules: list[list[Array]]) -> Ints:
    """Return the first vertex of each module, and the number of all."""
    return np.cumsum([0, *(sum(map(len, parts)) for parts in modules)])


def mesh_of(modules: list[list[Array]], apart: int) -> Mesh:
    """Return the mesh of modules, given the corners of their parts.

    Pairs of modules less than ``apart`` in the chain are exempt.
    """
    starts = starts_of(modules)
    hulls = {id(part): ConvexHull(part).simplices for parts in modules for part in parts}
    faces, edges, exempt = [], [], []
    for module, parts in enumerate(modules):
        start = starts[module]
        for part in parts:
            hull = hulls[id(part)]
            sides = np.sort(hull[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
            faces.append(start + hull)
            edges.append(start + np.unique(sides, axis=0))
            start += len(part)
        vertices = np.arange(starts[module], starts[module + 1])
        exempt.append(vertices[np.stack(np.triu_indices(len(vertices), 1), axis=1)])
        others = np.arange(starts[module + 1], starts[min(module + apart, len(modules))])
        exempt.append(np.stack(np.meshgrid(vertices, others), axis=-1).reshape(-1, 2))
    return Mesh(*(np.concatenate(rows).astype("i4") for rows in (faces, edges, exempt)))


@dataclass(frozen=True, slots=True)
class Division:
    """Interval in parts: vertices (parts + 1, V, 3) at their ends, and the deviation's bound."""

    vertices: Array
    deviation: float


class Vertices:
    """Positions of all vertices, seen from the middle module."""

    def __init__(self, plan: foldback_check.Plan) -> None:
        self.plan = plan
        self.middle = plan.count // 2
        self.starts = starts_of(parts_of(plan))
        self.kinds = np.resize(plan.module.piece, plan.count)
        self.solids = [
            np.concatenate([part.solid for part in piece]) for piece in plan.module.pieces
        ]

    def at(self, first: Array, last: Array, steps: int) -> Array:
        """Return vertices (steps + 1, V, 3) at equal steps from one configuration to another."""
        module = self.plan.module
        angles = first + np.linspace(0.0, 1.0, steps + 1)[:, None] * (last - first)
        q = angles.reshape(steps + 1, -1, len(module.names)).transpose(1, 2, 0)
        start = np.broadcast_to(np.eye(4, 3, -1)[:, :, None], (4, 3, steps + 1))
        poses = module.poses(q, start)
        poses = foldback_check.relative(poses[self.middle], poses)  # a centre, and axes as rows
        vertices = np.empty((steps + 1, self.starts[-1], 3))
        for kind, solid in enumerate(self.solids):
            modules = np.flatnonzero(self.kinds == kind)
            columns = self.starts[modules, None] + np.arange(len(solid))
            vertices[:, columns] = (solid @ poses[modules]).transpose(1, 0, 2, 3)
        return vertices

    def divide(self, frame: int, tolerance: float) -> Division:
        """Divide the interval after a frame so that straight motion is within a tolerance."""
        ends = frame, min(frame + 1, self.plan.frames - 1)
        first, last = (self.plan.angles(end, 0, len(self.plan.folded)) for end in ends)
        remainder = self._remainder(np.abs(last - first))
        parts = max(1, math.ceil((2.0 * remainder / tolerance) ** 0.2))
        while True:
            sampled = self.at(first, last, parts * STEPS_PER_PART)
            sampled_deviation = SPREAD * largest_deviation(sampled)
            deviation = sampled_deviation + remainder / parts**5
            if deviation <= tolerance:
                return Division(sampled[::STEPS_PER_PART], deviation)
            needed = math.sqrt(sampled_deviation / (tolerance - remainder / parts**5))
            parts = max(parts + 1, math.ceil(parts * needed * 1.01))

    def _remainder(self, turned: Array) -> float:
        """Return the interpolation's error if the whole interval is one part."""
        module, cut = self.plan.module, self.middle * len(self.plan.module.names)
        sides = ((turned[:cut].sum(), self.middle), (turned[cut:].sum(), self.plan.count))
        return REMAINDER * max(
            float(angle) ** 5 * float(links * module.length + module.radius)
            for angle, links in sides
        )


def largest_deviation(sampled: Array) -> float:
    """Return how far vertices (4 n + 1, V, 3) are from straight motion in each four steps."""
    ends = sampled[::STEPS_PER_PART]
    share = np.arange(1, STEPS_PER_PART)[:, None, None] / STEPS_PER_PART
    inner = sampled[:-1].reshape(len(ends) - 1, STEPS_PER_PART, -1, 3)[:, 1:]
    straight = ends[:-1, None] + share * np.diff(ends, axis=0)[:, None]
    return float(np.linalg.norm(inner - straight, axis=-1).max())


def toolkit() -> Any:
    """Return the module ipctk.

    Raises:
        InputError: ``no-ipctk`` if it is not installed.
    """
    try:
        ipctk = importlib.import_module("ipctk")
    except ImportError as error:
        raise InputError("no-ipctk", IPCTK_MISSING) from error
    ipctk.set_logger_level(ipctk.LoggerLevel.error)
    return ipctk


class _Detector:
    """Triangle mesh of a chain in ipctk."""

    def __init__(self, plan: foldback_check.Plan, distance: float) -> None:
        modules = parts_of(plan)
        self.ipctk, self.distance, self.starts = toolkit(), distance, starts_of(modules)
        self.narrow = self.ipctk.AdditiveCCD()
        mesh = mesh_of(modules, plan.module.apart)
        rest_positions = np.zeros((self.starts[-1], 3), order="F")
        self.mesh = self.ipctk.CollisionMesh(rest_positions, mesh.edges, mesh.faces)
        table = dict.fromkeys(map(tuple, mesh.exempt.tolist()), False)
        self.mesh.can_collide = self.ipctk.make_sparse_filter(table, True)

    def overlaps(self, vertices: Array) -> bool:
        """True if modules overlap, which continuous detection takes for granted they do not."""
        return bool(self.ipctk.has_intersections(self.mesh, np.asfortranarray(vertices)))

    def free(self, first: Array, last: Array) -> bool:
        """True if all pairs keep the distance; ipctk's documentation says the opposite."""
        return bool(
            self.ipctk.is_step_collision_free(
                self.mesh, first, last, self.distance, narrow_phase_ccd=self.narrow
            )
        )

    def contacts(self, ends: list[Array]) -> Iterator[tuple[float, Pair | None]]:
        """Yield the moments in [0, 1] of an interval at which modules come too close, and them."""
        for part, (first, last) in enumerate(pairwise(ends)):
            if not self.free(first, last):
                share, modules = self._nearest(first, last)
                yield (part + share) / (len(ends) - 1), modules

    def _nearest(self, first: Array, last: Array) -> tuple[float, Pair | None]:
        """Return the share of a part until the first contact, and its modules."""
        near = self.ipctk.Candidates()
        near.build(self.mesh, first, last, self.distance)
        hits: list[tuple[float, Pair]] = []
        for candidate in (*near.fv_candidates, *near.ee_candidates):
            ids = candidate.vertex_ids(self.mesh.edges, self.mesh.faces)
            ends = (vertices[ids].ravel() for vertices in (first, last))
            hit, moment = candidate.ccd(
                *ends, min_distance=self.distance, narrow_phase_ccd=self.narrow
            )
            if hit:
                first_module, second = sorted(
                    {int(np.searchsorted(self.starts, k, "right")) - 1 for k in ids}
                )
                hits.append((moment, (first_module, second)))
        return min(hits, default=(0.0, None))


def ask_ipctk(plan: foldback_check.Plan) -> Opinion:
    """Let ipctk look for contacts in all intervals of a plan.

    Raises:
        InputError: ``no-ipctk`` if it is not installed.
    """
    began = time.perf_counter()
    # 0.9 − 2 · 0.02 = 86 % of the claim is confirmed
    distance, tolerance = 0.9 * plan.claim, 0.02 * plan.claim
    detector, vertices = _Detector(plan, distance), Vertices(plan)
    contacts: list[Contact] = []
    parts, deviation = 0, 0.0
    intervals = max(1, plan.frames - 1)
    for frame in range(intervals):
        division = vertices.divide(frame, tolerance)
        if frame == 0 and detector.overlaps(division.vertices[0]):
            contacts.append(Contact(frame=0.0, modules=None))
        ends = [np.asfortranarray(end) for end in division.vertices]
        contact = next(detector.contacts(ends), None)
        if contact is not None:
            moment, modules = contact
            contacts.append(Contact(frame=frame + moment, modules=modules))
        parts, deviation = parts + len(ends) - 1, max(deviation, division.deviation)
    return Opinion(
        program=f"ipctk {detector.ipctk.__version__}",
        intervals=intervals,
        parts=parts,
        clearance=distance - 2.0 * deviation,
        deviation=deviation,
        contacts=tuple(contacts),
        seconds=time.perf_counter() - began,
    )


def opinion_of(path: Path, module_size: float, claim: float) -> Opinion:
    """Let ipctk look at a plan's file, with a module size and the clearance that is claimed for it.

    Raises:
        InputError: ``not-a-plan`` if it contradicts itself; ``no-ipctk`` if ipctk is missing.
    """
    try:
        plan = foldback_check.Plan(path, module_size, claim)
    except (foldback_check.NotProved, *UNREADABLE) as error:
        raise InputError("not-a-plan", f"{path.name}: {error}") from error
    return ask_ipctk(plan)
