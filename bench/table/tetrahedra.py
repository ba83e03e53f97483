"""Tetrahedra on a table: what their plans would ask there, and a trial of lying down straight.

``python -m bench --only table-tetrahedra``. Chains of tetrahedra fold floating; this is
how far a simple way on a table comes. All hinges are let go at once, by springs whose torque is
limited, in one MuJoCo tree that lies free under gravity; frames that ask more torque than a bound,
lie in the table or touch are taken back, and the springs are drawn anew.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from bench.tables import Section
from planner.certificate.table import table_certificate
from planner.certificate.table_figures import FRICTIONLESS
from planner.chain.chain import Chain
from planner.chain.rotations import wxyz_from_matrix
from planner.chain.statics import static_torque
from planner.clearance.clearance import closest
from planner.clearance.sweep import sweep
from planner.motion.motion import Motion
from planner.pathfinding.options import PathOptions
from planner.pipeline.fold import fold
from planner.pipeline.prepare import prepare
from planner.readers.gallery import Gallery
from planner.simulation.model import SOLIMP, Material, compiled, tree_spec
from planner.simulation.mujoco import mujoco
from planner.statics.balance import Balance
from planner.statics.contacts import floor_clearances
from planner.statics.stable_poses import resting_poses

Array = NDArray[np.float64]
SEEDS: Final = 12
VERIFY_SIZE: Final = 0.95
MOST_TORQUE: Final = 8.0
"""The bound never gets larger, in w·p; nor does the torque of a spring."""
FIRST_BOUND, RAISED_BY, REFUSALS = 1.5, 1.15, 12
"""The bound at first, its factor, and refusals for torque before it is raised; each frame that is
kept makes good for a fifth of one."""
STEP: Final = 0.025
"""Of the simulation, in √(pitch / gravity)."""
SPRING_RAD: Final = 0.2
"""Bend from which on a spring pulls with all that it has."""
SPRING: Final = 2.0
PATIENCE: Final = 1500
"""Frames without less bend, after which a run is stuck."""
MAX_TABLE_PENETRATION_PITCH: Final = 0.012
STRAIGHT_RAD: Final = 0.02
SPACING: Final = (0.05, 0.15)
"""Radians of a hinge, and pitches of a module, between two frames."""
TIP: Final = 0.002
"""Radius of the corners, which alone touch the table."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """What came of a run.

    Attributes:
        straight: Whether it came to lie straight.
        left: Sum of bends that are left, as a share of those that were.
        bound: Of the guard at the end, in w·p.
        frames: That were kept, from folded on.
        seconds: Wall time.
    """

    straight: bool
    left: float
    bound: float
    frames: Motion
    seconds: float


def table_tetrahedra(reference_seconds: float) -> Section:
    """The ring of twelve, two of 24, two of 48."""
    section = Section(name="table-tetrahedra")
    for name, chain in _chains():
        asked = table_certificate(chain, fold(chain).motion)
        held = static_torque(chain, np.zeros_like(chain.folded_rad))
        section.add(
            f"{name}, {len(chain)}: today's plan, {FRICTIONLESS}",
            f"held at its root {held:.0f} w·p, best resting pose of each frame "
            + ("never balances" if asked.torque is None else f"{asked.torque:.1f} w·p"),
        )
        tried = [_tried(section, name, chain, seed, reference_seconds) for seed in range(SEEDS)]
        good = [torque for torque in tried if torque is not None]
        section.add(
            f"{name}, {len(chain)}: straight within {MOST_TORQUE:g} w·p, {FRICTIONLESS}",
            f"{len(good)} of {SEEDS}" + (f", the least {min(good):.1f} w·p" if good else ""),
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
        made = prepare(str(cells).encode(), "cells.json", options)
        chains += [("×".join(map(str, sides)), made.chains[0])]
    return chains


def _tried(
    section: Section, name: str, chain: Chain, seed: int, reference_seconds: float
) -> float | None:
    """Torque in w·p of a run that is straight, rests and is clear; None of others."""
    trial = lie_down(chain, seed=seed)
    torque = None
    if trial.straight:
        found = table_certificate(chain, trial.frames[::-1], base="free", on_table=True)
        clear = sweep(chain, trial.frames.joint_angles_rad, size=VERIFY_SIZE).clearance > 0.0
        torque = found.torque if found.rests and clear else None
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
    """A run: from the pose in which the folded chain rests with the least torque."""
    return _Run(chain, seed).result()


class _Run:
    def __init__(self, chain: Chain, seed: int) -> None:
        self.chain, self.draws = chain, np.random.default_rng(seed)
        self.balance = Balance(chain)
        self.model: Any = compiled(_spec(chain))
        self.model.opt.timestep = STEP
        self.model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        self.data: Any = mujoco.MjData(self.model)
        joints = [self.model.joint(name) for name in chain.joint_names]
        self.angles_at = np.array([joint.qposadr[0] for joint in joints])
        self.rates_at = np.array([joint.dofadr[0] for joint in joints])
        self.root_at = int(self.model.joint("root").qposadr[0])
        self.bodies = np.array([self.model.body(f"module_{i}").id for i in range(len(chain))])
        self.bound, self.refused, self.stuck = FIRST_BOUND, 0.0, 0
        self.frames: list[Array] = []
        self.place()

    def place(self) -> None:
        """Lays the folded chain down."""
        chain, folded = self.chain, self.chain.folded_poses
        poses = [
            resting.of(folded.positions, folded.rotations)
            for resting in resting_poses(chain.module, folded.positions, folded.rotations)
        ]
        asked = [self.balance.solve(*pose, chain.folded_rad).torque for pose in poses]
        positions, rotations = poses[int(np.argmin(asked))]
        self.bound = max(FIRST_BOUND, 1.05 * min(asked))
        at, qpos = self.root_at, self.data.qpos
        qpos[at : at + 3] = positions[chain.root]
        qpos[at + 3 : at + 7] = wxyz_from_matrix(rotations[chain.root])
        qpos[self.angles_at] = chain.folded_rad
        mujoco.mj_forward(self.model, self.data)
        self.keep()

    def keep(self) -> None:
        """Takes the present configuration as a frame."""
        self.saved = self.data.qpos.copy(), self.data.qvel.copy()
        self.at = self.data.xpos[self.bodies].copy()
        self.frames.append(self.saved[0])

    def draw(self) -> None:
        """Springs and pushes, stronger the longer it has been stuck; some hinges are held."""
        draws, hinges = self.draws, len(self.angles_at)
        stronger = 1.0 + self.stuck / 150.0
        self.springs = draws.uniform(0.3, 1.0, hinges) * min(
            MOST_TORQUE, SPRING * draws.uniform(0.5, 2.0) * stronger
        )
        which, place = draws.integers(4), int(draws.integers(hinges))
        self.held = np.zeros(hinges, dtype=bool)
        if which == 0:
            self.held[:place] = True
        elif which == 1:
            self.held[place:] = True
        self.target = self.data.qpos[self.angles_at].copy()
        size = draws.choice([0.0, 1.0], p=[0.4, 0.6]) * draws.uniform(0.0, 0.25)
        pushes = draws.normal(size=(len(self.chain), 3)) * [1.0, 1.0, 0.5]
        alike = np.full(5, 0.4)
        self.pushes = (size * min(stronger, 4.0)) * np.column_stack(
            [np.convolve(axis, alike, "same") for axis in pushes.T]
        )
        self.left = int(draws.integers(40, 200))

    def step(self) -> bool:
        """A step; whether it is time for a frame."""
        data = self.data
        angles = data.qpos[self.angles_at]
        torques = np.clip(-self.springs * angles / SPRING_RAD, -self.springs, self.springs)
        holding = np.clip(-20.0 * (angles - self.target), -self.bound, self.bound)
        data.qfrc_applied[self.rates_at] = np.where(self.held, holding, torques)
        data.xfrc_applied[self.bodies, :3] = self.pushes
        mujoco.mj_step(self.model, data)
        data.qvel[:6] *= 0.9  # the root is the first joint
        self.left -= 1
        turned = np.abs(data.qpos[self.angles_at] - self.saved[0][self.angles_at]).max()
        moved = np.linalg.norm(data.xpos[self.bodies] - self.at, axis=1).max()
        return self.left <= 0 or turned > SPACING[0] or moved > SPACING[1]

    def fault(self) -> str:
        """What is wrong with the present configuration; empty where nothing is."""
        data, module = self.data, self.chain.module
        mujoco.mj_kinematics(self.model, data)
        positions = data.xpos[self.bodies].copy()
        rotations = data.xmat[self.bodies].reshape(-1, 3, 3).copy()
        if floor_clearances(module, positions, rotations) < -MAX_TABLE_PENETRATION_PITCH:
            return "sunk"
        if closest(module, positions, rotations, size=VERIFY_SIZE).clearance < 0.0:
            return "touching"
        angles = data.qpos[self.angles_at]
        return "" if self.balance.within(self.bound, positions, rotations, angles) else "torque"

    def refuse(self, fault: str) -> None:
        """Takes the last steps back."""
        self.data.qpos[:], self.data.qvel[:] = self.saved[0], 0.0
        mujoco.mj_forward(self.model, self.data)
        self.refused += 1.0
        if fault == "torque" and self.refused > REFUSALS and self.bound < MOST_TORQUE:
            self.bound, self.refused = min(RAISED_BY * self.bound, MOST_TORQUE), 0.0
        self.draw()

    def result(self) -> Trial:
        """Runs to the end."""
        begun = time.perf_counter()
        folded = float(np.abs(self.chain.folded_rad).sum())
        least, straight = folded, False
        self.draw()
        while not straight and self.stuck <= PATIENCE and self.refused <= 5 * REFUSALS:
            if not self.step():
                continue
            if fault := self.fault():
                self.refuse(fault)
                continue
            self.refused = max(0.0, self.refused - 0.2)
            self.keep()
            bends = np.abs(self.data.qpos[self.angles_at])
            straight = bool(bends.max() < STRAIGHT_RAD)
            better = bends.sum() < max(least - 0.2, 0.95 * least)
            least, self.stuck = (bends.sum(), 0) if better else (least, self.stuck + 1)
            if self.left <= 0:
                self.draw()
        return Trial(
            straight=straight,
            left=float(least) / folded,
            bound=self.bound,
            frames=self.motion(),
            seconds=time.perf_counter() - begun,
        )

    def motion(self) -> Motion:
        """All frames that were kept."""
        qpos, at = np.array(self.frames), self.root_at
        return Motion.from_frames(
            phase="explosion",
            time_s=np.arange(len(qpos), dtype=np.float64),
            joint_angles_rad=qpos[:, self.angles_at],
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
        for corner in chain.module.vertices:
            body.add_geom(
                type=mujoco.mjtGeom.mjGEOM_SPHERE,
                size=[TIP, 0.0, 0.0],
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
        pos=[0.0, 0.0, -TIP],
        condim=1,
        contype=0,
        conaffinity=2,
    )
    return spec
