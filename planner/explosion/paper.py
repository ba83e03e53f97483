"""The explosion as published: constant gains, fixed step, snapshots at a fixed interval.

The paper gives figures without units and leaves some out. How it was read, and which variants were
tried, stands in docs/decisions/0002-published-preset.md. Lengths are in pitches here and a module
weighs 1, so a force in the paper's units is divided by a module's mass in grams and the pitch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.chain.module import Module
from planner.errors import SimulationError
from planner.explosion.explosion import UNREPELLED_LINKS, Reports
from planner.explosion.recorder import FrameRecorder, Step
from planner.kernels.pairs import near_pairs, repulsion
from planner.motion.angle_steps import snapped
from planner.motion.motion import Motion
from planner.motion.record import Record, RecordStatus, Spent
from planner.parameters.published import PaperExplosionParameters
from planner.progress import Cancelled, Progress, Report, never, silent
from planner.simulation.model import Material
from planner.simulation.reduced import State
from planner.simulation.segments import Segments

Array = NDArray[np.float64]
MAX_STRAIGHT_BEND_RAD: Final = 0.05
"""Maximum bend of any hinge of a chain that counts as straight, rad. Chosen."""
MIN_STRAIGHT_SPAN_SHARE: Final = 0.99
"""Minimum distance of the ends of a straight chain, as a fraction of its length. Chosen."""
STRAIGHT_CHECK_STEPS: Final = 25
"""Steps between two checks for a straight chain. Chosen."""
COMMIT_EVERY_SNAPSHOTS: Final = 10
"""Snapshots between two commits of the recorder. Chosen."""
REST_CHECK_STEPS: Final = 5000
"""Steps between two checks for a chain at rest. Chosen."""
REST_RATE_RAD_S: Final = 1e-7
"""Largest hinge speed of a chain at rest, rad/s: slower than this it does not get straight within
the steps it has. Chosen."""
MAX_SNAPSHOT_ANGLES: Final = 20_000_000
"""Maximum number of angles in all snapshots together: 160 MB of memory. The wrench of 160 cubes has
three million. Chosen."""
FRAME_SPACING_RAD: Final = 0.03
"""Turn of a hinge since the last frame, rad, at which a snapshot is kept as a frame. Larger values
keep fewer. Chosen."""
FRAME_SPACING_PITCH: Final = 1.0
"""Distance of a module since the last frame, pitches, at which a snapshot is kept as a frame.
Larger values keep fewer. Chosen."""
BETWEEN_FRAMES_SIZE: Final = 0.95
"""Module size, as a fraction of the pitch, at which the motion between frames is checked, see
``planner.explosion.recorder``. Chosen."""


def explode_as_published(
    chain: Chain,
    parameters: PaperExplosionParameters,
    *,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explode a chain with the paper's parameters; see ``planner.explosion.simultaneous.explode``.

    The last snapshot, nearly straight, is followed by the straight configuration itself. Playback
    follows all snapshots; as frames only so many are kept as show the motion.
    """
    p = parameters
    reports = Reports()
    segments = Segments(chain, explosion_material(p, chain.module))
    recorder = FrameRecorder(
        chain,
        snapshot_rad=FRAME_SPACING_RAD,
        snapshot_distance=FRAME_SPACING_PITCH,
        size=BETWEEN_FRAMES_SIZE,
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
                if len(snapshots) % COMMIT_EVERY_SNAPSHOTS == 0:
                    recorder.commit()
            if len(snapshots) * len(state.angles) > MAX_SNAPSHOT_ANGLES:
                reason = (
                    f"the chain was not straight after {len(snapshots)} snapshots, the limit for "
                    "its length; set a longer snapshot_interval."
                )
                spent = Spent("snapshots", MAX_SNAPSHOT_ANGLES // len(state.angles), len(snapshots))
                break
            if steps % STRAIGHT_CHECK_STEPS == 0:
                if (
                    steps
                    and steps % REST_CHECK_STEPS == 0
                    and np.abs(state.rates).max() < REST_RATE_RAD_S
                ):
                    status, reason = "stalled", f"nothing moved any more after {steps} steps."
                    spent = Spent("motion", p.max_steps, steps)
                    break
                span = float(np.linalg.norm(positions[-1] - positions[0])) / (len(chain) - 1)
                if (
                    np.abs(state.angles).max() < MAX_STRAIGHT_BEND_RAD
                    and span >= MIN_STRAIGHT_SPAN_SHARE
                ):
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
            pairs = near_pairs(positions, p.repulsion_cutoff, UNREPELLED_LINKS + 1)
            repulsion(positions, pairs, repulsion_gain, forces)
            near = (
                pairs
                if reach <= p.repulsion_cutoff
                else near_pairs(positions, reach, UNREPELLED_LINKS + 1)
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
    """Return the joints and surfaces of the chain as it explodes."""
    return Material(
        geom_size=p.geom_size,
        friction=p.friction,
        stiffness=p.spring / (p.module_mass_g(module) * p.pitch_cm**2),
        stop_rad=float(np.deg2rad(p.stop_deg)),
        stiff_stops=True,
    )
