"""Balance: the smallest maximum hinge torque with which a chain stands on the floor.

Every module balances its weight, the floor's push, what touching modules push and what its joints
bear. Joints bear any force and any moment across their hinges; the moment about a hinge is its
motor's torque. Of all ways to balance the one is sought whose largest torque is least: a linear
program. That is a lower bound of limit analysis: right for motors that saturate and give way,
optimistic for servos that hold their position stiffly.

The joints' forces are eliminated: a hinge bears the moment of all that acts beyond it, and what is
left are unknown pushes along rays (``equilibrium_lp``).

Weights are 1 and lengths in pitches: torques are in w·p, the weight of a module times the pitch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.cantilever_statics import hinge_frames
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.planner.core import torque_columns
from foldback.planner.core.structures import EQUATIONS, Hinges
from foldback.planner.statics.contacts import FLOOR_GAP, MODULE_GAP, Contacts, contacts
from foldback.planner.statics.friction import Friction, rays, wider, with_estimated_drift

if TYPE_CHECKING:
    from foldback.planner.statics.equilibrium_lp import Columns

MIN_TORQUE_WP: Final = 0.01
"""Minimum torque of a hinge, in w·p (module weight × pitch), that differs from zero in the
equilibrium of a chain on a table: the search for equilibria with smaller torques ends there, and
smaller torques are reported as zero."""
EQUILIBRIUM_TOLERANCE_W: Final = 1e-3
"""Maximum residual force (module weights) or moment (module weight × pitch) on the whole chain in a
computed equilibrium; with more, the configuration counts as without equilibrium.
A smaller residual is rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Standing:
    """Equilibrium of a configuration. Torques in w·p, forces in weights of a module.

    Attributes:
        torque: Smallest maximum torque of the hinges; infinite without equilibrium.
        torques: (J,) torques of an equilibrium with that maximum, which the module before a hinge
            exerts on the one behind. NaN without equilibrium.
        contacts: Contacts of the chain with the floor and itself.
        forces: (C, 3) force on the first module of every contact.
    """

    torque: float
    torques: Array
    contacts: Contacts
    forces: Array

    @property
    def balances(self) -> bool:
        """True if an equilibrium exists."""
        return bool(np.isfinite(self.torque))

    @property
    def floor(self) -> tuple[Ints, Array, Array]:
        """(K,) modules, (K, 3) points and (K, 3) forces of the corners on the floor."""
        at = self.contacts.on_floor
        return self.contacts.first[at], self.contacts.points[at], self.forces[at]


class _Configuration(NamedTuple):
    """A configuration."""

    contacts: Contacts
    hinges: Hinges
    positions: Array
    rotations: Array


class Balance:
    """Solver for the equilibrium of configurations of a chain.

    Each solution starts from the last one.

    Args:
        chain: The chain.
        module_size: Module size as a fraction of the pitch, which places the corners.
        floor_gap, module_gap: Contact distances, pitches; see ``contacts``.
    """

    def __init__(
        self,
        chain: Chain,
        *,
        module_size: float = 1.0,
        floor_gap: float = FLOOR_GAP,
        module_gap: float = MODULE_GAP,
    ) -> None:
        from foldback.planner.statics.equilibrium_lp import Program  # late: it imports HiGHS

        self.chain = chain
        self.size = module_size
        self.floor_gap = floor_gap
        self.module_gap = module_gap
        self._program = Program()
        self._before = chain.module_before(np.arange(len(chain.folded_rad)))
        down = np.zeros((len(chain), 3))
        down[:, 2] = -1.0
        self._down = down
        self._all = np.arange(len(chain))
        self._none = np.full(len(chain), -1)

    def solve(
        self,
        positions: Array,
        rotations: Array,
        angles_rad: Array,
        *,
        friction: Friction | None = None,
        clamped: int | None = None,
        enough: float = MIN_TORQUE_WP,
    ) -> Standing:
        """Find the equilibrium of a configuration with the smallest maximum torque.

        Args:
            positions: (n, 3) centres in pitches; the floor is z = 0.
            rotations: (n, 3, 3) orientations.
            angles_rad: (J,) hinge angles, rad.
            friction: Friction with the floor; None for a smooth floor.
            clamped: Index of a module that is held in place by any force; None for a free chain.
            enough: Torque below which the search ends, w·p; larger values are faster.
        """
        touching = contacts(
            self.chain.module,
            positions,
            rotations,
            module_size=self.size,
            floor_gap=self.floor_gap,
            module_gap=self.module_gap,
        )
        axes, anchors = hinge_frames(
            self.chain, angles_rad, Poses(positions=positions, rotations=rotations)
        )
        hinges = Hinges(
            axes=np.ascontiguousarray(axes.reshape(-1, 3)),
            anchors=np.repeat(anchors, axes.shape[1], axis=0),
            before=self._before,
        )
        at = _Configuration(touching, hinges, np.array(positions, dtype=np.float64), rotations)
        if friction is not None and clamped is None and friction.positions is not None:
            smooth = self._solved(at, None, None, MIN_TORQUE_WP)
            if not smooth.balances:
                return smooth
            pressures = smooth.forces[touching.on_floor, 2]
            friction = with_estimated_drift(touching, friction, at.positions, rotations, pressures)
            narrow = self._solved(at, friction, None, enough)
            return narrow if narrow.balances else self._solved(at, wider(friction), None, enough)
        return self._solved(at, friction, clamped, enough)

    def within(
        self,
        bound: float,
        positions: Array,
        rotations: Array,
        angles_rad: Array,
        *,
        friction: Friction | None = None,
        clamped: int | None = None,
    ) -> bool:
        """Return True if a configuration stands with torques up to a bound, w·p; see ``solve``."""
        standing = self.solve(
            positions, rotations, angles_rad, friction=friction, clamped=clamped, enough=bound
        )
        return standing.torque <= bound * (1.0 + 1e-6)

    def _solved(
        self, at: _Configuration, friction: Friction | None, clamped: int | None, enough: float
    ) -> Standing:
        """Find the smallest maximum torque for one friction model."""
        touching, joints = at.contacts, len(self._before)
        contact_rows, forces = rays(touching, friction, at.positions, at.rotations)
        root = self.chain.root if clamped is None else clamped
        is_clamped = clamped is not None
        first, second, points = (
            touching.first[contact_rows],
            touching.second[contact_rows],
            touching.points[contact_rows],
        )
        matrix = torque_columns(at.hinges, root, is_clamped, first, second, points, forces)
        weight = self._weight(at.hinges, root, is_clamped, at.positions)
        max_scale = 1.0 / max(enough, MIN_TORQUE_WP)
        pushes = self._program.pushes(
            _keys(touching, contact_rows), matrix, weight, joints, max_scale
        )
        loads = weight + _times(matrix, pushes, len(weight))
        if np.abs(loads[joints:]).max(initial=0.0) > EQUILIBRIUM_TOLERANCE_W:
            nothing = np.full((len(touching), 3), np.nan)
            return Standing(
                torque=np.inf, torques=np.full(joints, np.nan), contacts=touching, forces=nothing
            )
        on_first = np.zeros((len(touching), 3))
        np.add.at(on_first, contact_rows, pushes[:, None] * forces)
        largest = float(np.abs(loads[:joints]).max(initial=0.0))
        return Standing(
            torque=0.0 if largest <= MIN_TORQUE_WP * (1.0 + 1e-6) else largest,
            torques=loads[:joints],
            contacts=touching,
            forces=on_first,
        )

    def _weight(self, hinges: Hinges, root: int, is_clamped: bool, positions: Array) -> Array:
        """Return the (rows,) load of the modules' weights on every row."""
        _, rows, values = torque_columns(
            hinges, root, is_clamped, self._all, self._none, positions, self._down
        )
        count = len(self._before) + (0 if is_clamped else EQUATIONS)
        return np.bincount(rows, values, minlength=count).astype(np.float64)


def _keys(touching: Contacts, contact_rows: Ints) -> Ints:
    """Return (R,) keys that identify rays from frame to frame."""
    ray = np.arange(len(contact_rows)) - np.searchsorted(contact_rows, contact_rows)
    first, second = touching.first[contact_rows], touching.second[contact_rows]
    return ((first << 20 | second + 1) << 20 | touching.feature[contact_rows] + 1 << 4) | ray


def _times(matrix: Columns, pushes: Array, count: int) -> Array:
    """Return the (count,) product of a sparse matrix of columns with a vector."""
    starts, rows, values = matrix
    products = values * np.repeat(pushes, np.diff(starts))
    return np.bincount(rows, products, minlength=count).astype(np.float64)
