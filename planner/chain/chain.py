"""Chain: modules in order, joined by joints, with the configuration it folds into."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.close_points import first_close_pair
from foldback.planner.chain.corners import lowest_corners
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.chain.module import IndexT, Module
from foldback.planner.chain.path import (
    DEFAULT_PITCH_M,
    MIN_CELLS,
    Path,
    check_pitch,
)
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.chain.trail import Trail, hinge_axes
from foldback.planner.core import least_separation, near_pairs
from foldback.planner.errors import InputError

OVERLAP_SIZE: Final = 0.98
"""Size, as a fraction of full size, at which modules of a folded shape must not overlap: at 1,
rounding would refuse good chains."""
OVERLAP_ROUNDING: Final = 1e-6
"""Depth of an overlap, in pitches, up to which it counts as rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Chain:
    """A chain and its folded configuration. *Straight* is all zeros.

    Attributes:
        name: Name of the shape it folds into.
        module: The kind of module.
        folded_rad: (J,) hinge angles of the folded configuration, read-only.
        folded_position: (3,) centre of module 0 when folded, in pitches.
        folded_wxyz: (4,) orientation of module 0 when folded.
        pitch_m: Distance of neighbouring modules in metres.
    """

    name: str
    module: Module
    folded_rad: Array
    folded_position: Array
    folded_wxyz: Array
    pitch_m: float = DEFAULT_PITCH_M

    @classmethod
    def from_path(cls, path: Path, *, module: Module = CUBE) -> Chain:
        """Build the chain whose folded modules sit in the cells of a path, in its order.

        Frames are parallel-transported along the path, so that each angle is exactly 0 or ±90°.
        """
        links = np.diff(path.cells, axis=0).astype(np.float64)
        frame = _frame_along(links[0])
        first = frame
        angles = np.zeros((len(links) - 1, 2))
        quarter = np.pi / 2
        for k, link in enumerate(links[1:]):
            local = frame.T @ link
            if abs(local[1]) > 0.5:
                angles[k, 0] = quarter * np.sign(local[1])
                sine = np.sign(local[1])
                frame = frame @ np.array([[0.0, -sine, 0.0], [sine, 0.0, 0.0], [0.0, 0.0, 1.0]])
            elif abs(local[2]) > 0.5:
                sine = -np.sign(local[2])
                angles[k, 1] = quarter * sine
                frame = frame @ np.array([[0.0, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, 0.0]])
        return cls._checked(
            name=path.name,
            module=module,
            folded=angles.reshape(-1),
            position=path.cells[0].astype(np.float64),
            wxyz=wxyz_from_matrix(first),
            pitch_m=path.pitch_m,
        )

    @classmethod
    def from_trail(cls, trail: Trail) -> Chain:
        """Build the chain of tetrahedra whose folded modules lie between the nodes of a trail.

        A module's x axis runs from its first node to its second, its y and z axes along the hinges
        there; the next module's y axis is this one's z axis. Each angle is exactly 0 or ±90°.
        """
        steps = np.diff(trail.nodes, axis=0)
        axes = hinge_axes(trail.nodes)
        along = steps.astype(np.float64)
        across = np.empty_like(along)
        across[0] = np.eye(3)[axes[0]]
        angles = np.zeros(len(along) - 1)
        for k in range(len(along)):
            up = np.cross(along[k], across[k])
            if k + 1 < len(along):
                angles[k] = np.sign(along[k + 1] @ across[k]) * np.pi / 2
                across[k + 1] = up
        first = np.column_stack([along[0], across[0], np.cross(along[0], across[0])])
        return cls._checked(
            name=trail.name,
            module=TETRAHEDRON,
            folded=angles,
            position=(trail.nodes[0] + trail.nodes[1]) / 2.0,
            wxyz=wxyz_from_matrix(first),
            pitch_m=trail.pitch_m,
        )

    @classmethod
    def from_angles(
        cls,
        module: Module,
        angles_rad: Array,
        *,
        name: str = "chain",
        pitch_m: float = DEFAULT_PITCH_M,
        first_position: Array | None = None,
        first_wxyz: Array | None = None,
    ) -> Chain:
        """Build a chain from the hinge angles of its folded configuration.

        Args:
            module: The kind of module.
            angles_rad: (J,) or (joints, hinges) angles of the folded configuration.
            name: Name of the shape.
            pitch_m: Distance of neighbouring modules in metres.
            first_position: (3,) centre of module 0 when folded; the origin when None.
            first_wxyz: (4,) its orientation, of any length but none; upright when None.

        Raises:
            InputError: Angles that are not numbers or not within the joints' range, or a folded
                configuration in which modules overlap.
        """
        folded = np.array(angles_rad, dtype=np.float64).reshape(-1)
        position = np.zeros(3) if first_position is None else np.array(first_position, np.float64)
        wxyz = np.array([1.0, 0.0, 0.0, 0.0] if first_wxyz is None else first_wxyz, np.float64)
        length = float(np.linalg.norm(wxyz))
        if not 1e-6 < length < 1e6:
            raise InputError(
                "bad-orientation",
                f"got {wxyz.tolist()} as the orientation of module 0, expected a unit quaternion "
                "(w, x, y, z).",
            )
        chain = cls._checked(
            name=name,
            module=module,
            folded=folded,
            position=position,
            wxyz=wxyz / length,
            pitch_m=pitch_m,
        )
        check_overlap(chain)
        return chain

    @classmethod
    def _checked(
        cls,
        *,
        name: str,
        module: Module,
        folded: Array,
        position: Array,
        wxyz: Array,
        pitch_m: float,
    ) -> Chain:
        hinges = module.hinges_per_joint
        if len(folded) == 0:
            raise InputError("wrong-count", f"got 0 angles, expected at least {hinges}.")
        if len(folded) % hinges:
            raise InputError(
                "wrong-count",
                f"got {len(folded)} angles, expected a multiple of {hinges}, because each joint "
                f"has {hinges} hinges.",
            )
        if not np.isfinite(folded).all():
            index = int(np.argmin(np.isfinite(folded)))
            raise InputError(
                "not-finite",
                f"got {folded[index]:g}, expected a finite number.",
                where="angle {angle}",
                angle=index,
            )
        holders = module.rigid_links + np.arange(len(folded) // hinges)
        low, high = module.stops_behind(holders).reshape(-1, 2).T
        if (outside := (folded < low) | (folded > high)).any():
            index = int(np.argmax(outside))
            raise InputError(
                "out-of-range",
                f"got {np.rad2deg(folded[index]):g}°, expected "
                f"{_range_text(float(low[index]), float(high[index]))}.",
                where=f"joint {index // hinges}",
            )
        check_pitch(pitch_m)
        for array in (folded, position, wxyz):
            array.setflags(write=False)
        return cls(
            name=name,
            module=module,
            folded_rad=folded,
            folded_position=position,
            folded_wxyz=wxyz,
            pitch_m=float(pitch_m),
        )

    def __len__(self) -> int:
        """Return the number of modules."""
        return self.module.module_count(len(self.folded_rad))

    def from_other_end(self) -> Chain:
        """Return the chain of cubes through the same cells from the last one on."""
        cells = np.rint(self.folded_poses.positions).astype(np.int64)
        path = Path.from_cells(cells[::-1], name=self.name, pitch_m=self.pitch_m)
        return Chain.from_path(path, module=self.module)

    @property
    def joint_count(self) -> int:
        """Number of joints; a joint has one hinge or two."""
        return len(self.folded_rad) // self.module.hinges_per_joint

    def hinges_of(self, joint: int | Ints) -> Ints:
        """Return the (…, K) hinges of a joint, or of each of an array of joints."""
        return self.module.hinges_of(joint)

    def module_before(self, hinge: IndexT) -> IndexT:
        """Return the module on the near side of a hinge, of one or of each of an array."""
        return self.module.module_before(hinge)

    def module_after(self, hinge: IndexT) -> IndexT:
        """Return the module on the far side of a hinge, of one or of each of an array."""
        return self.module.module_after(hinge)

    @property
    def ranges_rad(self) -> Array:
        """(J, 2) smallest and largest angle of each hinge; infinite where it turns freely."""
        return self.module.ranges_behind(self._holders).reshape(-1, 2)

    def stops_rad(self, early_rad: float = 0.0, joints: slice = slice(None)) -> Array:
        """Return (J, 2) finite angles at which motions of the hinges stop.

        Args:
            early_rad: Angle before the ends of their ranges at which they do; but the folded and
                the extended chain lie between the stops.
            joints: Joints whose hinges are meant; all by default.
        """
        low, high = self.module.stops_behind(self._holders[joints]).reshape(-1, 2).T
        folded = self.folded_rad.reshape(-1, self.module.hinges_per_joint)[joints].ravel()
        low = np.minimum(low + early_rad, np.maximum(low, np.minimum(folded, 0.0)))
        high = np.maximum(high - early_rad, np.minimum(high, np.maximum(folded, 0.0)))
        return np.stack([low, high], axis=1)

    @property
    def _holders(self) -> Ints:
        """Modules that joints are behind."""
        return self.module.rigid_links + np.arange(self.joint_count)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """(J,) names of the hinge angles."""
        return self.module.joint_names(len(self))

    @property
    def root(self) -> int:
        """Index of the middle module: its pose is the root pose of every configuration."""
        return len(self) // 2

    @property
    def folded_poses(self) -> Poses:
        """Poses of all modules in the folded configuration."""
        return forward_kinematics(
            self.module,
            self.folded_rad,
            root=0,
            root_position=self.folded_position,
            root_wxyz=self.folded_wxyz,
        )

    @property
    def table_height(self) -> float:
        """Height of the table that it stands on when folded, along z, in pitches."""
        poses = self.folded_poses
        return float(lowest_corners(self.module, poses.positions, poses.rotations).min())

    def poses(self, angles_rad: Array, root_position: Array, root_wxyz: Array) -> Poses:
        """Return poses of all modules for (..., J) angles and the (..., 3), (..., 4) root pose."""
        return forward_kinematics(
            self.module,
            angles_rad,
            root=self.root,
            root_position=root_position,
            root_wxyz=root_wxyz,
        )


def _range_text(low: float, high: float) -> str:
    least, most = np.rad2deg(low), np.rad2deg(high)
    if low == -high:
        return f"at most {most:g}° in either direction"
    return f"{least:g}° to {most:g}°"


def check_overlap(chain: Chain) -> None:
    """Refuse a chain whose folded modules lie in one another.

    On a lattice, two modules overlap if their centres are closer than twice the radius of the ball
    that fits into one; of other modules, all parts are compared.

    Raises:
        InputError: ``overlap``, naming two modules.
    """
    if chain.module.filling not in ("cells", "rings"):
        _check_overlap_of_parts(chain)
        return
    positions = chain.folded_poses.positions
    closest = 2.0 * chain.module.inner_radius * OVERLAP_SIZE
    pair = first_close_pair(positions, closest)
    if pair is not None:
        i, j = pair
        distance = float(np.linalg.norm(positions[i] - positions[j]))
        raise InputError(
            "overlap",
            "modules {modules} overlap in the folded shape: the distance between their centres is "
            "{distance:.3g} pitches, but must be at least {min_distance:.3g} pitches; change the "
            "angles of the joints between these modules.",
            where="modules {modules}",
            modules=[int(i), int(j)],
            distance=distance,
            min_distance=closest,
        )


def _check_overlap_of_parts(chain: Chain) -> None:
    module, poses = chain.module, chain.folded_poses
    positions = np.ascontiguousarray(poses.positions)
    rotations = np.ascontiguousarray(poses.rotations)
    pairs = near_pairs(positions, 2.0 * module.radius * OVERLAP_SIZE, module.apart)
    separation, i, j = least_separation(
        positions, rotations, pairs, module.hull, OVERLAP_SIZE, OVERLAP_ROUNDING
    )
    if separation < -OVERLAP_ROUNDING:
        raise InputError(
            "overlap",
            "modules {modules} overlap in the folded shape by {depth:.3g} pitches; change the "
            "angles of the joints between these modules.",
            where="modules {modules}",
            modules=[int(i), int(j)],
            depth=-separation,
        )


def _frame_along(direction: Array) -> Array:
    """Return a right-handed lattice frame (3, 3) whose x axis is a unit lattice direction."""
    axis = int(np.argmax(np.abs(direction)))
    side = np.zeros(3)
    side[(axis + 1) % 3] = 1.0
    return np.column_stack([direction, side, np.cross(direction, side)])


__all__ = ["MIN_CELLS", "Chain", "check_overlap"]
