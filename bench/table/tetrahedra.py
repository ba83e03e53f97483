"""Tetrahedra on a table: torques of their floating plans, and trials of unfolding.

``python -m bench --only table-tetrahedra``. Chains of tetrahedra fold floating; this trial measures
how well a simple method unfolds them on a table. All hinges are released at the same time in one
MuJoCo tree that lies free under gravity, and springs of limited torque straighten them. Frames that
need more torque than a bound, penetrate the table or touch themselves are rejected, and new spring
torques are drawn.

Units: pitch, module weight and √(pitch / gravity); torques in w·p.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.sections import Section
from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.chain.cantilever_statics import static_torque
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.clearance.clearance import closest
from foldback.planner.clearance.sweep import sweep
from foldback.planner.motion.motion import Motion
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.fold import fold
from foldback.planner.pipeline.prepare import prepare
from foldback.planner.readers.gallery import Gallery
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.planner.simulation.mujoco_models import SOLIMP, Material, compiled, tree_spec
from foldback.planner.statics.balance import Balance
from foldback.planner.statics.contacts import floor_clearances
from foldback.planner.statics.stable_poses import resting_poses

Array = NDArray[np.float64]
SEEDS_PER_CHAIN: Final = 12
"""Number of random seeds with which the simulation tries to unfold each chain of tetrahedra on a
table."""
VERIFY_SIZE: Final = 0.95
"""Size of the tetrahedra, as a fraction of the pitch, at which they must not collide; frames with a
collision are rejected."""
MAX_TORQUE_WP: Final = 8.0
"""Maximum joint torque that a frame may need under gravity, and maximum torque of a spring that
straightens a hinge, in w·p (module weight × pitch)."""
FIRST_BOUND_WP: Final = 1.5
"""Smallest initial limit of the joint torque that a frame may need under gravity, in w·p (module
weight × pitch); the limit rises when too many frames are rejected."""
BOUND_FACTOR: Final = 1.15
"""Factor by which the limit of the joint torque is raised after too many rejected frames."""
REJECTIONS_PER_RAISE: Final = 12
"""Number of rejected frames, less a fifth of the accepted ones, above which the next rejection for
too high a torque raises the torque limit; five times as many end the trial."""
TIME_STEP: Final = 0.025
"""Time step of the simulation, in √(pitch / gravity)."""
SATURATION_RAD: Final = 0.2
"""Hinge angle at and above which the spring that straightens the hinge exerts its full torque, in
rad; below it the torque is proportional to the angle."""
SPRING_TORQUE_WP: Final = 2.0
"""Typical maximum torque of the springs that straighten the hinges, in w·p (module weight × pitch);
each draw multiplies it by a random factor. A larger value unfolds faster, and more frames are
rejected for their torque."""
MAX_STALLED_FRAMES: Final = 1500
"""Number of accepted frames without a smaller sum of the hinge angles, beyond which the trial is
given up."""
MAX_TRIAL_PENETRATION_PITCH: Final = 0.012
"""Maximum depth by which a module may penetrate the table, whose contacts are soft, in pitches;
deeper frames are rejected."""
MAX_TRIAL_BEND_RAD: Final = 0.02
"""Hinge angle below which all hinges must be for the chain to count as straight, in rad, which ends
the trial with success."""
FRAME_SPACING: Final = (0.05, 0.15)
"""Rotation of a hinge, rad, and displacement of a module, pitches, after which a frame is
recorded."""
CORNER_RADIUS_PITCH: Final = 0.002
"""Radius of the small spheres at the corners of a module, in pitches, which are its only parts that
touch the table in the simulation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """Result of a trial.

    Attributes:
        straight: True if the chain ends straight.
        left: Sum of the remaining hinge angles as a fraction of their sum when folded.
        bound: Torque bound at the end, w·p.
        frames: Accepted frames, from folded on.
        seconds: Wall time, s.
    """

    straight: bool
    left: float
    bound: float
    frames: Motion
    seconds: float


def table_tetrahedra(reference_seconds: float) -> Section:
    """Try the ring of twelve, two chains of 24 tetrahedra and two of 48."""
    section = Section(name="table-tetrahedra")
    for name, chain in _chains():
        asked_certificate = table_certificate(chain, fold(chain).motion)
        rod_torque = static_torque(chain, np.zeros_like(chain.folded_rad))
        section.add(
            f"{name}, {len(chain)}: today's plan, without friction",
            f"held at its root {rod_torque:.0f} w·p, best resting pose of each frame "
            + (
                "never balances"
                if asked_certificate.torque is None
                else f"{asked_certificate.torque:.1f} w·p"
            ),
        )
        trials = [
            _tried(section, name, chain, seed, reference_seconds) for seed in range(SEEDS_PER_CHAIN)
        ]
        good = [torque for torque in trials if torque is not None]
        section.add(
            f"{name}, {len(chain)}: straight within {MAX_TORQUE_WP:g} w·p, without friction",
            f"{len(good)} of {SEEDS_PER_CHAIN}"
            + (f", the least {min(good):.1f} w·p" if good else ""),
            "tried, told",
        )
    return section


def _chains() -> list[tuple[str, Chain]]:
    chains: list[tuple[str, Chain]] = []
    for name in ("tetra-ring", "tetra-dodecahedron"):
        example = Gallery().shape(name)
        assert example is not None
        chains += [(name, prepare(example.data, f"{name}.json").chains[0])]
    for sides in ((2, 1, 1), (4, 1, 1), (2, 2, 1)):
        cells = np.argwhere(np.ones(sides, dtype=bool)).tolist()
        options = PathOptions(module="tetrahedron", as_voxels=True)
        preparation = prepare(str(cells).encode(), "cells.json", options)
        chains += [("×".join(map(str, sides)), preparation.chains[0])]
    return chains


def _tried(
    section: Section, name: str, chain: Chain, seed: int, reference_seconds: float
) -> float | None:
    """Return the torque of a trial that is straight, stable and clear, w·p; else None."""
    trial = lie_down(chain, seed=seed)
    torque = None
    if trial.straight:
        certificate = table_certificate(chain, trial.frames[::-1], base="free", on_table=True)
        clear = sweep(chain, trial.frames.joint_angles_rad, module_size=VERIFY_SIZE).clearance > 0.0
        torque = certificate.torque if certificate.rests and clear else None
    section.rows.append(
        {
            "case": name,
            "modules": len(chain),
            "seed": seed,
            "straight": trial.straight,
            "bend_left": trial.left,
            "bound_wp": trial.bound,
            "torque_wp": torque,
            "frames": len(trial.frames),
            "seconds": trial.seconds,
            "references": trial.seconds / reference_seconds,
        }
    )
    return torque


def lie_down(chain: Chain, *, seed: int) -> Trial:
    """Run a trial, from the stable pose of the folded chain that needs the least torque."""
    return _Run(chain, seed).result()


class _Tree:
    """MuJoCo tree of a chain on the table, and its state."""

    def __init__(self, chain: Chain) -> None:
        self.model: Any = compiled(_spec(chain))
        self.model.opt.timestep = TIME_STEP
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.data: Any = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in chain.joint_names]
        self.angles_at = np.array([joint.qposadr[0] for joint in joints])
        self.rates_at = np.array([joint.dofadr[0] for joint in joints])
        self.root_at = int(self.model.joint("root").qposadr[0])
        self.bodies = np.array([self.model.body(f"module_{i}").id for i in range(len(chain))])

    @property
    def angles(self) -> Array:
        """(J,) hinge angles, rad."""
        return self.data.qpos[self.angles_at]

    @property
    def positions(self) -> Array:
        """(n, 3) positions of the modules, pitches."""
        return self.data.xpos[self.bodies]

    def poses(self) -> tuple[Array, Array]:
        """Return positions and rotation matrices of the modules at the present angles."""
        mujoco.mj_kinematics(self.model, self.data)
        return self.positions, self.data.xmat[self.bodies].reshape(-1, 3, 3).copy()

    def place(self, position: Array, wxyz: Array, angles: Array) -> None:
        """Put the root at a pose and the hinges at angles."""
        at, qpos = self.root_at, self.data.qpos
        qpos[at : at + 3], qpos[at + 3 : at + 7] = position, wxyz
        qpos[self.angles_at] = angles
        mujoco.mj_forward(self.model, self.data)

    def restore(self, qpos: Array) -> None:
        """Return to a configuration, at rest."""
        self.data.qpos[:], self.data.qvel[:] = qpos, 0.0
        mujoco.mj_forward(self.model, self.data)

    def step(self, torques: Array, forces: Array) -> None:
        """Take one time step with torques of hinges and forces on modules; damp the root."""
        self.data.qfrc_applied[self.rates_at] = torques
        self.data.xfrc_applied[self.bodies, :3] = forces
        mujoco.mj_step(self.model, self.data)
        self.data.qvel[:6] *= 0.9  # the root is the first joint


@dataclass(frozen=True, slots=True, kw_only=True)
class _Drive:
    """Forces that act during some steps.

    Attributes:
        springs: (J,) maximum torque of the spring of each hinge, w·p.
        is_held: (J,) True for hinges that hold their angle instead.
        held_rad: (J,) angles that these hold.
        forces: (n, 3) forces on modules, module weights.
        steps: Number of steps until the next draw.
    """

    springs: Array
    is_held: NDArray[np.bool_]
    held_rad: Array
    forces: Array
    steps: int

    @classmethod
    def drawn(cls, rng: np.random.Generator, tree: _Tree, stalled: int) -> _Drive:
        """Draw forces, stronger ones after more stalled frames; hold some hinges."""
        hinges = len(tree.angles_at)
        stronger = 1.0 + stalled / 150.0
        springs = rng.uniform(0.3, 1.0, hinges) * min(
            MAX_TORQUE_WP, SPRING_TORQUE_WP * rng.uniform(0.5, 2.0) * stronger
        )
        direction, border = rng.integers(4), int(rng.integers(hinges))
        is_held = np.zeros(hinges, dtype=bool)
        if direction == 0:
            is_held[:border] = True
        elif direction == 1:
            is_held[border:] = True
        size = rng.choice([0.0, 1.0], p=[0.4, 0.6]) * rng.uniform(0.0, 0.25)
        forces = rng.normal(size=(len(tree.bodies), 3)) * [1.0, 1.0, 0.5]
        neighbours_alike = np.full(5, 0.4)
        smooth = [np.convolve(axis, neighbours_alike, "same") for axis in forces.T]
        return cls(
            springs=springs,
            is_held=is_held,
            held_rad=tree.angles,
            forces=(size * min(stronger, 4.0)) * np.column_stack(smooth),
            steps=int(rng.integers(40, 200)),
        )

    def torques(self, angles: Array, bound: float) -> Array:
        """Return the (J,) torques at hinge angles; those of held hinges are limited by a bound."""
        torques = np.clip(-self.springs * angles / SATURATION_RAD, -self.springs, self.springs)
        holding = np.clip(-20.0 * (angles - self.held_rad), -bound, bound)
        return np.where(self.is_held, holding, torques)


class _Run:
    """One trial: drives the tree, and accepts or rejects its frames."""

    def __init__(self, chain: Chain, seed: int) -> None:
        self.chain, self.rng = chain, np.random.default_rng(seed)
        self.balance, self.tree = Balance(chain), _Tree(chain)
        self.rejections, self.stalled = 0.0, 0
        self.frames: list[Array] = []
        self.bound = self.place()
        self.accept()
        self.draw()

    def place(self) -> float:
        """Put the folded chain in its best stable pose; return the torque bound for it, w·p."""
        chain, folded = self.chain, self.chain.folded_poses
        poses = [
            resting.of(folded.positions, folded.rotations)
            for resting in resting_poses(chain.module, folded.positions, folded.rotations)
        ]
        needed = [self.balance.solve(*pose, chain.folded_rad).torque for pose in poses]
        positions, rotations = poses[int(np.argmin(needed))]
        wxyz = wxyz_from_matrix(rotations[chain.root])
        self.tree.place(positions[chain.root], wxyz, chain.folded_rad)
        return max(FIRST_BOUND_WP, 1.05 * min(needed))

    def accept(self) -> None:
        """Record the present configuration as a frame."""
        self.frames.append(self.tree.data.qpos.copy())
        self.positions = self.tree.positions

    def reject(self, reason: str) -> None:
        """Return to the last frame; raise the bound after enough rejections for torque."""
        self.tree.restore(self.frames[-1])
        self.rejections += 1.0
        enough = self.rejections > REJECTIONS_PER_RAISE
        if reason == "torque" and enough and self.bound < MAX_TORQUE_WP:
            self.bound, self.rejections = min(BOUND_FACTOR * self.bound, MAX_TORQUE_WP), 0.0
        self.draw()

    def draw(self) -> None:
        """Draw forces for the next steps."""
        self.drive = _Drive.drawn(self.rng, self.tree, self.stalled)
        self.steps_left = self.drive.steps

    def step(self) -> bool:
        """Take a step; return True if a frame is due."""
        tree = self.tree
        tree.step(self.drive.torques(tree.angles, self.bound), self.drive.forces)
        self.steps_left -= 1
        turned = np.abs(tree.angles - self.frames[-1][tree.angles_at]).max()
        moved = np.linalg.norm(tree.positions - self.positions, axis=1).max()
        return self.steps_left <= 0 or turned > FRAME_SPACING[0] or moved > FRAME_SPACING[1]

    def fault(self) -> str:
        """Return the reason to reject the present configuration; empty if there is none."""
        module = self.chain.module
        positions, rotations = self.tree.poses()
        if floor_clearances(module, positions, rotations) < -MAX_TRIAL_PENETRATION_PITCH:
            return "sunk"
        if closest(module, positions, rotations, module_size=VERIFY_SIZE).clearance < 0.0:
            return "touching"
        within = self.balance.within(self.bound, positions, rotations, self.tree.angles)
        return "" if within else "torque"

    def result(self) -> Trial:
        """Run the trial to its end."""
        start_s = time.perf_counter()
        folded = float(np.abs(self.chain.folded_rad).sum())
        smallest, straight = folded, False
        max_rejections = 5 * REJECTIONS_PER_RAISE
        while (
            not straight
            and self.stalled <= MAX_STALLED_FRAMES
            and self.rejections <= max_rejections
        ):
            if not self.step():
                continue
            if fault := self.fault():
                self.reject(fault)
                continue
            self.rejections = max(0.0, self.rejections - 0.2)
            self.accept()
            bends = np.abs(self.tree.angles)
            straight = bool(bends.max() < MAX_TRIAL_BEND_RAD)
            better = bends.sum() < max(smallest - 0.2, 0.95 * smallest)
            smallest, self.stalled = (bends.sum(), 0) if better else (smallest, self.stalled + 1)
            if self.steps_left <= 0:
                self.draw()
        return Trial(
            straight=straight,
            left=float(smallest) / folded,
            bound=self.bound,
            frames=self.motion(),
            seconds=time.perf_counter() - start_s,
        )

    def motion(self) -> Motion:
        """Return all accepted frames."""
        qpos, at = np.array(self.frames), self.tree.root_at
        return Motion.from_frames(
            phase="explosion",
            time_s=np.arange(len(qpos), dtype=np.float64),
            joint_angles_rad=qpos[:, self.tree.angles_at],
            root_position=qpos[:, at : at + 3],
            root_wxyz=qpos[:, at + 3 : at + 7],
        )


def _spec(chain: Chain) -> Any:
    spec = tree_spec(
        chain, Material(geom_size=0.98, armature=0.2, damping=2.0, contact_time_constant=0.1)
    )
    spec.option.gravity = [0.0, 0.0, -1.0]
    for i in range(len(chain)):
        body = spec.body(f"module_{i}")
        for corner in chain.module.pieces[0].corners:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[CORNER_RADIUS_PITCH, 0.0, 0.0],
                pos=corner.tolist(),
                mass=0.0,
                condim=1,
                contype=2,
                conaffinity=0,
                priority=1,
                solref=[0.06, 1.0],
                solimp=SOLIMP,
            )
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[0.0, 0.0, 1.0],
        pos=[0.0, 0.0, -CORNER_RADIUS_PITCH],
        condim=1,
        contype=0,
        conaffinity=2,
    )
    return spec
