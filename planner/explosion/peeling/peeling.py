"""Peeling: a long chain leaves its folded core unit by unit, from its far end.

Only a window of modules near the unit that was released last is simulated. What is still folded is
the core, boxes that don't move; what is straight already is one rod on the window's last module. So
a step costs the same whatever the chain's length, and the whole grows linearly with it.

Within the window it is the explosion of the paper with three additions: the radial force comes from
behind the unit, the last module is pulled along the ray by which the unit gets away, and a torque
turns the rod into that ray.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.core import floating_peel_steps, window_stiffness
from foldback.planner.core.structures import FloatingDrive, StepsDone, WindowBody
from foldback.planner.explosion.loop.checkpoint import (
    MAX_STALLED_PULSES,
    BendDecrease,
    Checkpoint,
    Pulses,
)
from foldback.planner.explosion.loop.explosion_loop import (
    PULSE_REPULSION_SCALE,
    STOP_COMPLIANCE_RAD,
    Watch,
    run,
)
from foldback.planner.explosion.loop.radial_forces import radial_weights
from foldback.planner.explosion.loop.recorder import Guard, Mark, Recorder, Refusal
from foldback.planner.explosion.loop.step_control import (
    WEAK_TENSION_SCALE,
    ContactDepth,
    StepControl,
)
from foldback.planner.explosion.peeling.core import Core, CoreOnTable
from foldback.planner.explosion.peeling.recorder import Proof, WindowRule
from foldback.planner.explosion.peeling.run import (
    CHECK_STEPS,
    SAME_HEADING_COSINE,
    Peeling,
    PeelingRules,
)
from foldback.planner.explosion.peeling.window import (
    Heading,
    Peelable,
    ReleasePoint,
    Window,
    WindowConfiguration,
    WindowForces,
    WindowRun,
    WindowSetting,
)
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.explosion import PeelingParameters
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.simulation.contact_finder import ContactFinder
from foldback.planner.simulation.mujoco_models import Material

STIFFNESS_STEPS: Final = 5
"""Number of simulation steps for which the springs of a floating window keep their stiffness, which
follows from the distances of the modules from the core."""


def peel(
    chain: Chain,
    parameters: PeelingParameters,
    *,
    seed: int = 0,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Peel a folded chain off its core, from its last module on, and record the motion.

    Args:
        chain: A chain of cubes, starting in its folded configuration.
        parameters: Parameters of the peeling.
        seed: Seed of the slight unevenness of the radial gain.
        sink: Receives the snapshots as they are made.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.

    Returns:
        The record, whether straight or not.

    Raises:
        InputError: ``not-peelable`` for modules that are no cubes, or off the lattice.
    """
    watch = Watch(progress, cancelled, "peeling")
    peeling = floating_peeling(chain, parameters, seed=seed, sink=sink, watch=watch)
    return run(peeling, "peel")


def floating_peeling(
    chain: Chain,
    parameters: PeelingParameters,
    *,
    seed: int = 0,
    sink: Callable[[Motion], None] | None = None,
    watch: Watch,
) -> Peeling:
    """Build the parts of a peeling that floats; the arguments are those of ``peel``."""
    peelable = Peelable(chain)
    pulses = Pulses(MAX_STALLED_PULSES["peel"])
    return build_peeling(
        peelable,
        parameters,
        forces=FloatingForces(parameters, radial_weights(seed, len(chain)), pulses),
        surroundings=peelable.core,
        rules=FloatingRules(pulses),
        pulses=pulses,
        min_progress_rad=0.5,
        sink=sink,
        watch=watch,
    )


def build_peeling(
    peelable: Peelable,
    parameters: PeelingParameters,
    *,
    forces: WindowForces,
    surroundings: Core | CoreOnTable,
    rules: PeelingRules,
    pulses: Pulses,
    min_progress_rad: float,
    guard: Guard[WindowConfiguration] | None = None,
    sink: Callable[[Motion], None] | None,
    watch: Watch,
) -> Peeling:
    """Build a peeling of a chain from the parts that depend on where it takes place."""
    chain = peelable.chain
    material = Material(
        geom_size=parameters.geom_size,
        stiffness=parameters.spring,
        armature=parameters.armature,
        stops_early_rad=STOP_COMPLIANCE_RAD,
    )
    window = Window(
        WindowSetting(
            peelable=peelable,
            parameters=parameters,
            material=material,
            finder=ContactFinder(chain, material),
            forces=forces,
            surroundings=surroundings,
        )
    )
    proof = Proof(chain, parameters.verify_size)
    rule = WindowRule(peelable, proof, parameters.snapshot_rad, parameters.snapshot_distance)
    room = 0.9 * (parameters.geom_size - parameters.verify_size)
    allowed = ContactDepth.within(room, 0.016)  # pitches
    return Peeling(
        world=window,
        # Contacts at a checkpoint may be deeper than allowed already: what makes them less deep is
        # no reason to restart again.
        control=StepControl.adaptive(parameters, allowed, depth_after_restart=np.inf),
        checkpoint=Checkpoint(window.time_s, window.state),
        pulses=pulses,
        recorder=Recorder(rule, sink, guard=guard),
        watch=watch,
        proof=proof,
        progress=BendDecrease(min_progress_rad, parameters.patience),
        rules=rules,
    )


@dataclass(frozen=True, slots=True)
class FloatingForces:
    """Forces on a floating window: radial with the wanted tension, the pull at its end, and eq. 3.

    Attributes:
        parameters: Gains.
        weights: (n,) relative radial gains of the chain's modules.
        pulses: Pulses of weak tension and strong repulsion.
    """

    parameters: PeelingParameters
    weights: Array
    pulses: Pulses
    max_steps: ClassVar[int] = CHECK_STEPS

    def make_steps(self, window: Window, body: WindowBody, run: WindowRun) -> StepsDone:
        """Make steps of a window, and go on with the pulse and the turn of the heading."""
        heading = window.heading
        aims = heading.aims(len(run.steps.time_s), self.parameters.turn_rad)
        done = floating_peel_steps(body, self._drive(window, aims), run.state, run.find, run.steps)
        self.pulses.advance(done.made)
        aim = aims[min(done.made, len(aims)) - 1]
        window.heading = Heading(aim, heading.target, heading.centre)
        return done

    def stiffness(self, window: Window) -> Array:
        """Return the (H,) stiffness of the springs, which grows with the distance from the core."""
        stiffness = np.empty_like(window.state.angles)
        drive = self._drive(window, [window.heading.aim])
        window_stiffness(window.model.positions, drive, stiffness)
        return stiffness

    def _drive(self, window: Window, aims: list[Array]) -> FloatingDrive:
        """Return strengths and directions of the forces, as kernels take them."""
        p = self.parameters
        return FloatingDrive(
            weights=self.weights[window.first : window.first + window.modules],
            centre=window.heading.centre,
            aims=np.array(aims),
            field=window.held.field,
            spring=p.spring,
            stiffening=p.stiffening,
            gain=p.repulsion_gain,
            tension=p.tension,
            pull=p.pull,
            alignment=p.alignment,
            weak_gain=PULSE_REPULSION_SCALE,
            weak_tension=WEAK_TENSION_SCALE,
            weak_steps=self.pulses.weak_steps,
            stiffness_period=STIFFNESS_STEPS,
        )


@dataclass(frozen=True, slots=True)
class FloatingRules:
    """Rules of a peeling that floats: pulses are its remedy, and contacts make it wait.

    Attributes:
        pulses: Pulses of weak tension and strong repulsion.
    """

    pulses: Pulses
    max_finish_contacts: ClassVar[float] = 0.0

    def is_ready(self, window: Window, control: StepControl) -> bool:
        """Return True if the next unit may be released."""
        p, heading = window.setting.parameters, window.heading
        # The joints next to the core may have to wait for what lies in their way.
        hinges = window.setting.peelable.hinges
        unit = np.abs(window.state.angles[hinges * p.skipped : hinges * window.held.unit])
        return bool(
            control.is_shallow
            and control.contacts <= p.release_contacts
            and window.modules < max(p.window, 1.2 * p.unit)
            and unit.max(initial=0.0) < p.release_rad
            and window.rod_direction @ heading.aim > 0.5  # 60°
            and heading.aim @ heading.target > SAME_HEADING_COSINE
        )

    def is_ready_in_jam(self, window: Window, control: StepControl) -> bool:
        """Return True if the window has room for the next unit."""
        p = window.setting.parameters
        return window.modules + p.unit <= p.most_modules and control.is_shallow

    def allows(self, configurations: Sequence[WindowConfiguration]) -> bool:
        """Return True: the clearance is all that counts."""
        del configurations
        return True

    def committed(self) -> None:
        """Do nothing."""

    def released(self, point: ReleasePoint, mark: Mark[WindowConfiguration], first: int) -> None:
        """Do nothing: no run returns to a release."""

    def answer(self, refusal: Refusal, window: Window, step: int) -> None:
        """Do nothing: there is no guard."""

    def loosen(self, step: int) -> None:
        """Start a pulse."""
        del step
        self.pulses.start()

    def loosen_jam(self, step: int) -> None:
        """Begin with the weak part of the pulse that has been counted."""
        del step
        self.pulses.weaken()

    def progressed(self) -> None:
        """Do nothing: the pulse ends by itself."""

    def retreat(self, peeling: Peeling) -> bool:
        """Return False: no run returns to a release."""
        del peeling
        return False

    def end(self, window: Window) -> None:
        """Return None: there is no limit of the forces."""
