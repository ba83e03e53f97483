"""Explosion: forces on the folded chain until it is straight. The paper's *record*.

Motors are off. Each module is pulled from the centre of mass (eq. 1, 2) and pushed away from near
modules that are not linked to it (eq. 3). Gains, time step and drag adapt: the radial gain so that
the force that adds up along the chain stays within what the joints' springs can order, the step so
that no contact goes deeper than the module size that the plan is verified at allows.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from planner.chain.chain import Chain
from planner.errors import SimulationError
from planner.explosion.explosion import (
    COMMIT_EVERY,
    MOST_RETRIES,
    STOP_GIVES_RAD,
    STRONG_REPULSION,
    WEAK_TENSION,
    ContactDepth,
    Ended,
    Explosion,
)
from planner.explosion.recorder import FrameRecorder, Step
from planner.explosion.straightening import straightening
from planner.kernels.pairs import PairLimits, max_inverse_step_limit, near_pairs, repulsion
from planner.motion.frames import Frames
from planner.motion.record import Record
from planner.parameters.explosion import ExplosionParameters
from planner.pathfinding.knots import knot_of
from planner.progress import Cancelled, Report, never, silent
from planner.simulation.model import Material
from planner.simulation.reduced import Acceleration, State
from planner.simulation.rigid_blocks import Blocks
from planner.simulation.segments import Segments

Array = NDArray[np.float64]
Engine = Segments | Blocks
LINKED: Final = 1
"""Links apart up to which two modules do not repel each other."""
FINISH_EVERY: Final = 50
"""Steps between two tries to straighten what is left by kinematics, at first."""
FINISH_RARELY: Final = (1.5, 800.0)
"""Factor of those steps after each try in vain, and what they grow to: a try takes as long as ten
steps of a long chain, or more."""
KNOT_EVERY: Final = 200
"""Steps between two looks whether the chain is knotted."""
KNOT_FROM: Final = 0.4
"""How far it must be unfolded, from 0 to 1, before a knot is looked for: packed ends show knots
that are none."""
CREEP: Final = 0.1
"""Force along the chain on each module of a chain that creeps, in its direction. All move along
the chain itself, whose curve stays where it is: one end follows it through every loop and out."""
COMING_APART: Final = (0.05, 0.25)
"""How far it is unfolded when repulsion begins to grow, and when it is at its strongest."""
JAM_WINDOW: Final = 400
"""Steps between two looks whether the chain is jammed."""
EXACT_FROM: Final = 1500
"""Modules above which a record is played back as it is, and stops begin earlier: they give a
little, which a curve would cut to the joints' range."""
SHORT: Final = 512
"""Modules up to which ends go no faster than ``ExplosionParameters.body_cap``."""
MOST_LONGER: Final = 2.5
"""Factor of that for longer chains, at most: a step goes no farther than pairs are looked for. What
is between two snapshots grows with its square once the chain has come apart."""
STUCK_RAD: Final = 1.0
"""Bend above which a hinge that has not moved counts as stuck."""
LEAST_PROGRESS: Final = 0.005
"""How much ``unfolded``, from 0 to 1, must grow from look to look."""
DEEP: Final = 0.02
"""Depth of contacts in pitches, at most; less where the module size to verify leaves less."""


def explode(
    chain: Chain,
    parameters: ExplosionParameters,
    *,
    seed: int = 0,
    sink: Callable[[Frames], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Explodes a folded chain and records how it comes out straight.

    Args:
        chain: The chain, starting in its folded configuration.
        parameters: How it is let go.
        seed: Decides a slight unevenness of the radial gain.
        sink: Gets the snapshots as they are made.
        progress: Told how far it is, a few times a second.
        cancelled: Asked now and then whether to stop.

    Returns:
        The record, whatever came of it.
    """
    return Simultaneous(chain, parameters, seed, sink).run(progress, cancelled)


class Simultaneous(Explosion[Step, ExplosionParameters]):
    """A run in which all modules are let go at once."""

    strategy = "simultaneous"
    doing = "exploding"

    def __init__(
        self,
        chain: Chain,
        parameters: ExplosionParameters,
        seed: int,
        sink: Callable[[Frames], None] | None,
    ) -> None:
        room = 2.0 * chain.module.inner_radius * (parameters.geom_size - parameters.verify_size)
        longer = float(np.clip(len(chain) / SHORT, 1.0, MOST_LONGER))
        self.spacing = longer**2
        """How many times as far apart snapshots are once the chain has come apart."""
        self.frames = FrameRecorder(
            chain,
            snapshot_rad=parameters.snapshot_rad,
            snapshot_distance=parameters.snapshot_distance,
            size=parameters.verify_size,
            sink=sink,
        )
        super().__init__(
            parameters,
            ContactDepth.within(room, DEEP),
            self.frames,
            seed=seed,
            modules=len(chain),
        )
        self.chain = chain
        self.material = Material(
            geom_size=parameters.geom_size,
            stiffness=parameters.spring,
            armature=parameters.armature,
            stop_rad=chain.module.stop_rad - (STOP_GIVES_RAD if len(chain) > EXACT_FROM else 0.0),
        )
        # The ends of a long chain go as far as it is long.
        self.body_cap = longer * parameters.body_cap
        self.engine = self.first_engine()
        folded = chain.folded_poses
        self.state = State.at_rest(
            chain.folded_rad, folded.positions[chain.root], folded.rotations[chain.root]
        )
        self.sound = self.saved = (0.0, self.state.copy())
        self.contacts = 0
        """In the last step; −1 when it went back."""
        self.pairs = np.zeros((0, 2), dtype=np.int64)
        self.farthest = -1.0
        """How far it was unfolded when last something moved on."""
        self.window_angles = np.abs(chain.folded_rad)
        self.knotted = False
        """Whether it was seen to be, when last looked at."""
        self.way, self.crept = 0, 0.0
        """1 for a chain that creeps towards its last module, −1 for the other way, 0 when that is
        to be chosen; and how far it has."""
        self.finish_at, self.finish_wait = 0, float(FINISH_EVERY)

    def first_engine(self) -> Engine:
        """What gives the accelerations from the folded configuration on."""
        return Segments(self.chain, self.material)

    @property
    def most_steps(self) -> int:
        """Of one run."""
        return self.parameters.max_steps

    def place(self) -> None:
        """Computes the poses of the present state."""
        self.engine.place(self.state)

    def snapshot(self) -> Step:
        """The present state."""
        return Step.of(self.time_s, self.state, self.engine.positions)

    def motion(self) -> Frames:
        """All snapshots."""
        return self.frames.motion()

    def look(self) -> Ended | None:
        """Whether the chain can be straightened, or is stuck."""
        if self.steps % FINISH_EVERY == 0 and self.contacts == 0 and self.finish():
            return "straight"
        if self.steps % KNOT_EVERY == 0 and self.may_creep():
            loose = self.knotted or self.unfolded() >= KNOT_FROM
            was, self.knotted = self.knotted, loose and not self.is_unknot()
            if was != self.knotted:
                self.way, self.crept = 0, 0.0
        if self.steps % JAM_WINDOW == 0 and not self.unjam():
            return "stalled"
        return None

    def accelerations(self) -> Acceleration | None:
        """Under eq. 1 and 3; None when the run went back."""
        positions = self.engine.positions
        self.pairs = near_pairs(positions, self.parameters.repulsion_cutoff, LINKED + 1)
        self.engine.set_contact_time_constant(self.contact_time_constant())
        self.contacts = -1
        forces = self._forces(positions)
        try:
            acceleration = self.acceleration_under(forces)
        except SimulationError:
            if self.retries >= MOST_RETRIES:
                raise
            self.go_back()
            return None
        if self.is_too_deep(acceleration.depth) and self.retries < MOST_RETRIES:
            self.go_back()
            return None
        if self.steps % COMMIT_EVERY == 0:
            self.sound = (self.time_s, self.state.copy())
        self.contacts = acceleration.contacts
        return acceleration

    def acceleration_under(self, forces: Array) -> Acceleration:
        """Under forces on the modules."""
        engine = self.engine
        if isinstance(engine, Segments):
            return engine.lean_accelerations(self.state, forces, self.pairs)
        return engine.accelerations(self.state, forces)

    def step(self) -> bool:
        """One step, after which no hinge is beyond its stop."""
        moved = super().step()
        if isinstance(self.engine, Segments):
            self.state.stop_at(self.material.stop_of(self.chain.module))
        return moved

    def _forces(self, positions: Array) -> Array:
        """(n, 3) forces: eq. 1 with the gain that gives the wanted tension, and eq. 3."""
        p = self.parameters
        weak, creeps = self.is_weak(), self.creeps()
        arms = positions - positions.mean(axis=0)
        diameter = 2.0 * float(np.sqrt((arms**2).sum(axis=1).max()))
        radial = self.weights[:, None] * arms / diameter
        radial -= radial.mean(axis=0)
        summed = float(np.sqrt((np.cumsum(radial, axis=0) ** 2).sum(axis=1).max()))
        gain = p.tension * p.spring * self.tension / summed
        forces = gain * (WEAK_TENSION if weak or creeps else 1.0) * radial
        if creeps:
            forces += self._creep(positions)
        apart = self.apart()
        self.frames.spacing = 1.0 + (self.spacing - 1.0) * apart
        push = p.repulsion_gain * (1.0 + (p.loose_repulsion - 1.0) * apart)
        push *= STRONG_REPULSION if weak and not creeps else 1.0
        repulsion(positions, self.pairs, push, forces)
        return forces

    def apart(self) -> float:
        """0 while the chain is packed, 1 once it has come apart."""
        low, high = COMING_APART
        return float(np.clip((self.unfolded() - low) / (high - low), 0.0, 1.0))

    def _creep(self, positions: Array) -> Array:
        """(n, 3) forces along the chain, from the end that its sharpest bends are nearer to.

        Once it has gone its own length in vain, the other way.
        """
        along = np.gradient(positions, axis=0)
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        if not self.way:
            bends = np.abs(self.state.angles)
            sharp = np.flatnonzero(bends > 0.5 * bends.max())
            self.way = 1 if sharp.mean() < 0.5 * len(bends) else -1
        speed = self.way * float((self.engine.velocities * along).sum(axis=1).mean())
        self.crept += self.step_s * speed
        if self.crept > len(positions):
            self.way, self.crept = -self.way, 0.0
        return CREEP * self.way * along

    def may_creep(self) -> bool:
        """Whether the chain is simulated as such, and not in blocks."""
        return isinstance(self.engine, Segments)

    def is_unknot(self) -> bool:
        """Whether the chain as it is now is seen to be one."""
        return knot_of(self.engine.positions).verdict == "unknot"

    def creeps(self) -> bool:
        """Whether the chain creeps in this step: while it is knotted, and in every other push."""
        pushed = self.pulse_left > 0 and self.pushes % 2 == 0 and self.may_creep()
        return self.knotted or pushed

    def excess(self) -> float:
        """By hinges, near modules, and all modules."""
        p = self.parameters
        state, engine = self.state, self.engine
        engine.place(state)
        loose = np.abs(state.angles).max() < p.loose_rad
        limits = PairLimits(
            radius=self.chain.module.radius,
            approach=p.pair_cap_loose if loose else p.pair_cap,
            slide=p.slide_cap,
        )
        return max(
            float(np.abs(state.rates).max()) / p.joint_cap_rad,
            max_inverse_step_limit(engine.modules, self.pairs, limits),
            float(np.sqrt((engine.velocities**2).sum(axis=1).max())) / self.body_cap,
        )

    def commit(self) -> None:
        """Makes the steps so far final: the run goes back to the last one, not behind.

        That is one whose contacts were looked at, and not where its step has led since.
        """
        self.recorder.commit()
        self.saved = self.sound
        self.retries = 0

    def finish(self) -> bool:
        """Ends the run by pure kinematics if the chain can be straightened without a touch."""
        if self.steps < self.finish_at:
            return False
        if np.abs(self.state.angles).max() > self.parameters.finish_rad:
            return False
        rest = straightening(
            self.chain,
            self.state,
            start_s=self.time_s,
            snapshot_rad=self.spacing * self.parameters.snapshot_rad,
            snapshot_distance=self.spacing * self.parameters.snapshot_distance,
            size=self.parameters.verify_size,
        )
        if rest is None:
            factor, most = FINISH_RARELY
            self.finish_wait = min(factor * self.finish_wait, most)
            self.finish_at = self.steps + round(self.finish_wait)
            return False
        self.place()
        self.recorder.add(self.snapshot())
        self.recorder.commit(end=True)
        self.frames.append(rest)
        return True

    def unjam(self) -> bool:
        """Starts a pulse when nothing moves on; False when enough of them were in vain."""
        angles = np.abs(self.state.angles)
        stuck = (angles > STUCK_RAD) & (angles > self.window_angles - 0.05)
        eased = (angles > 0.6).sum() < 0.95 * (self.window_angles > 0.6).sum()
        self.window_angles = angles
        unfolded = self.unfolded()
        advanced = unfolded > self.farthest + LEAST_PROGRESS
        if advanced:
            self.farthest = unfolded
            self.pushes = 0
        if (stuck.any() and not eased) or not advanced:
            self.push()
        return self.pushes <= self.most_pushes

    def unfolded(self) -> float:
        """0 when folded, 1 when straight: half by the joints' bends, half by the chain's span."""
        positions = self.engine.positions
        # A chain that folds into a line has nothing to unbend.
        bent = np.abs(self.state.angles).sum() / max(np.abs(self.chain.folded_rad).sum(), 1e-9)
        span = np.linalg.norm(positions[-1] - positions[0]) / (len(positions) - 1)
        return float(0.5 * (1.0 - bent) + 0.5 * span)

    def stall_reason(self) -> str:
        """Which joint stays bent."""
        angles = np.abs(self.state.angles).reshape(-1, self.chain.module.hinges_per_joint)
        worst = int(np.argmax(angles.max(axis=1))) + self.chain.module.rigid_links
        return (
            f"the chain is stuck: {self.pushes} random pushes in a row made no progress. The joint "
            f"of module {worst} is still bent by {np.rad2deg(angles.max()):.0f}°. Try another "
            "seed, or another path through the same cells."
        )
