"""The explosion as published: constant gains, fixed step, snapshots at a fixed interval.

The paper gives figures without units and leaves some out. What is read into it, and what was tried,
stands in docs/decisions/0002-published-preset.md. Lengths are in pitches here and a module weighs
1, so a force in the paper's units is divided by a module's mass in grams and the pitch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.module import Module
from planner.errors import SimulationError
from planner.explosion.explosion import Reports
from planner.explosion.recorder import FrameRecorder, Step
from planner.kernels.pairs import near_pairs, repulsion
from planner.motion.angle_steps import snapped
from planner.motion.frames import Frames
from planner.motion.record import Record, RecordStatus, Spent
from planner.parameters.published import PaperExplosionParameters
from planner.progress import Cancelled, Progress, Report, never, silent
from planner.simulation.model import Material
from planner.simulation.reduced import State
from planner.simulation.segments import Segments

Array = NDArray[np.float64]
LINKED: Final = 1
"""Links apart up to which two modules do not repel each other."""
STRAIGHT_RAD: Final = 0.05
"""Every hinge is below this when the chain counts as straight."""
STRAIGHT_SPAN: Final = 0.99
"""Share of the chain's length that its ends are apart when it counts as straight."""
CHECK_EVERY: Final = 25
"""Steps between two looks whether it is straight."""
COMMIT_EVERY: Final = 10
STILL_STEPS: Final = 5000
"""Steps between two looks whether it has come to rest."""
STILL_RATE: Final = 1e-7
"""Hinge speed in rad/s below which a chain does not get straight within the steps it has."""
MOST_ANGLES: Final = 20_000_000
"""Numbers in all snapshots together, 160 MB; the wrench of 160 cubes has three million."""
KEPT_RAD: Final = 0.03
"""Turn of a hinge since the last frame, from which on a snapshot is kept as one."""
KEPT_DISTANCE: Final = 1.0
"""Way of a module since the last frame in pitches, from which on a snapshot is kept as one."""
VERIFIED_SIZE: Final = 0.95
"""Module size at which frames in between are checked, see ``planner.explosion.recorder``."""


def explode_as_published(
    chain: Chain,
    parameters: PaperExplosionParameters,
    *,
    sink: Callable[[Frames], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explodes a chain with the paper's parameters; see ``planner.explosion.simultaneous.explode``.

    The last snapshot, nearly straight, is followed by the straight configuration itself. Playback
    follows all snapshots; as frames only so many are kept as show the motion.
    """
    p = parameters
    reports = Reports()
    segments = Segments(chain, explosion_material(p, chain.module))
    recorder = FrameRecorder(
        chain,
        snapshot_rad=KEPT_RAD,
        snapshot_distance=KEPT_DISTANCE,
        size=VERIFIED_SIZE,
        sink=sink,
    )
    folded = chain.folded_poses
    state = State.at_rest(
        chain.folded_rad, folded.positions[chain.root], folded.rotations[chain.root]
    )
    bent = float(np.abs(chain.folded_rad).sum())
    force = p.module_mass_g(chain.module) * p.pitch_cm
    radial_gain = p.radial_gain / force
    repulsion_gain = p.repulsion_gain / p.pitch_cm**2 / force
    drag = p.damping / (1.0 - p.damping) / p.step_s
    reach = 2.0 * chain.module.radius * p.geom_size
    status: RecordStatus = "timeout"
    reason = f"the chain was not straight after {p.max_steps} steps."
    steps = 0
    spent: Spent | None = None
    snapshots: list[Array] = []
    try:
        while steps < p.max_steps:
            segments.place(state)
            positions = segments.positions
            if steps % p.snapshot_interval == 0:
                recorder.add(Step.of(steps * p.step_s, state, positions))
                snapshots.append(state.angles.copy())
                if len(snapshots) % COMMIT_EVERY == 0:
                    recorder.commit()
            if len(snapshots) * len(state.angles) > MOST_ANGLES:
                reason = (
                    f"the chain was not straight after {len(snapshots)} snapshots, the limit for "
                    "its length; set a longer snapshot_interval."
                )
                spent = Spent("snapshots", MOST_ANGLES // len(state.angles), len(snapshots))
                break
            if steps % CHECK_EVERY == 0:
                if steps and steps % STILL_STEPS == 0 and np.abs(state.rates).max() < STILL_RATE:
                    status, reason = "stalled", f"nothing moved any more after {steps} steps."
                    spent = Spent("motion", p.max_steps, steps)
                    break
                span = float(np.linalg.norm(positions[-1] - positions[0])) / (len(chain) - 1)
                if np.abs(state.angles).max() < STRAIGHT_RAD and span >= STRAIGHT_SPAN:
                    status, reason = "straight", ""
                    break
                if cancelled():
                    status, reason = "cancelled", "the explosion was cancelled."
                    break
                if (rate := reports.steps_per_second(steps)) is not None:
                    left = float(np.abs(state.angles).sum()) / bent
                    progress(
                        Progress(
                            stage="explode",
                            fraction=float(np.clip(0.5 * (1.0 - left) + 0.5 * span, 0.0, 0.99)),
                            steps=steps,
                            steps_per_second=rate,
                            simulated_s=steps * p.step_s,
                            message="exploding as published",
                        )
                    )
            arms = positions - positions.mean(axis=0)
            forces = radial_gain * arms
            pairs = near_pairs(positions, p.repulsion_cutoff, LINKED + 1)
            repulsion(positions, pairs, repulsion_gain, forces)
            near = (
                pairs if reach <= p.repulsion_cutoff else near_pairs(positions, reach, LINKED + 1)
            )
            acceleration = (
                segments.free_accelerations(state, forces)
                if segments.is_free(state, near)
                else segments.accelerations(state, forces)
            )
            state.accelerate(acceleration, p.step_s, drag)
            state.advance(p.step_s)
            steps += 1
        else:
            spent = Spent("steps", p.max_steps, steps)
    except SimulationError as error:
        status, reason = "diverged", f"the simulation failed: {error}"
        spent = Spent("retries", 0, 0)
    recorder.commit(end=True)
    if status == "straight":
        state.angles[:] = 0.0
        snapshots.append(state.angles.copy())
    segments.place(state)
    recorder.add(Step.of(steps * p.step_s, state, segments.positions))
    recorder.commit(end=True)
    return Record(
        status=status,
        reason=reason,
        frames=recorder.motion(),
        steps=steps,
        seconds=reports.seconds,
        snapshots_rad=snapped(np.array(snapshots), chain.module.angle_limit_rad),
        spent=spent,
    )


def explosion_material(p: PaperExplosionParameters, module: Module) -> Material:
    """Joints and surfaces of the chain as it explodes."""
    return Material(
        geom_size=p.geom_size,
        friction=p.friction,
        stiffness=p.spring / (p.module_mass_g(module) * p.pitch_cm**2),
        stop_rad=float(np.deg2rad(p.stop_deg)),
        stiff_stops=True,
    )
