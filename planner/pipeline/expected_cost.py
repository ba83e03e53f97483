"""Expected cost: processor time that a fold is likely to take, and the least that it can take.

The service shares its processors out by it and refuses what cannot end within its limits. Seconds
are of one core of the machine that docs/reproduction.md names, measured on snakes through boxes and
on shapes of the gallery; what it depends on is counted in steps of a simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.module import Module
from foldback.planner.explosion.strategy_cost import COSTS_IN_LAYERS, COSTS_INTERLOCKED
from foldback.planner.parameters.explosion import MUJOCO
from foldback.planner.parameters.parameters import FLOATING, Parameters
from foldback.planner.parameters.playback import PUBLISHED_PLAYBACK, PlaybackParameters
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.pathfinding.expected_duration import expected_seconds, smoothing_seconds
from foldback.planner.pipeline.preference import COMPUTING
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.playback.robot_runs import mujoco_seconds
from foldback.planner.playback.simulation_work import is_simulated

MAX_EXPECTED_S: Final = 3600.0
"""Maximum expected cost of a fold, in s of processor time; larger estimates are cut to it, because
the time limit of a stage ends a fold about then."""
SHORT_RANGE_WEIGHT: Final = 0.125
"""Weight, from 0 to 1, of repulsion and hinge springs relative to the radial force, where the cost
of the published method is estimated; both act only near contacts or straight hinges. Fitted."""
LOOSE_STEP_S: Final = 3e-6
"""Processor time of one simulation step of the published explosion per module, in s, averaged over
a fold whose chain comes loose. Measured."""
PACKED_STEP_S: Final = 9e-6
"""Processor time of one simulation step of the published explosion per module, in s, if the chain
stays folded (many contacts) because the settings do not drive it apart. Measured."""
SERVO_STEP_S: Final = 6e-6
"""Processor time of one simulation step of a playback (servos follow the plan) per module, in s,
with few contacts. Measured."""
USUALLY_PEELED_MODULES: Final = 730
"""Number of modules from which on most chains are peeled: docs/decisions/0017-portfolio.md."""
DEFAULT_PARAMETERS: Final = Parameters()
"""Parameters for which the durations of folds were measured; the estimate of a fold's cost adds the
difference between its own parameters and these."""
LOWER_BOUND_FRACTION: Final = 0.25
"""Fraction of its expected cost that a fold takes at the very least. A fold is refused if this
lower bound exceeds its time limit. Measured costs are within a factor of two."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedCost:
    """Cost of a fold.

    Attributes:
        expected_s: Processor time of the whole fold, in seconds.
        least_s: Least time of its longest stage, in seconds.
        stage: Name of that stage.
        cause: Part of the request that makes it take so long.
        remedy: Alternative request, as a sentence.
    """

    expected_s: float
    least_s: float = 0.0
    stage: str = "explode"
    cause: str = "the fold"
    remedy: str = "Use a smaller shape."


def expected_cost(modules: int, request: FoldRequest) -> ExpectedCost:
    """Return what a fold is expected to cost.

    Args:
        modules: Number of modules of its chain.
        request: A valid request.
    """
    parameters = request.parameters()
    explosion = parameters.explosion
    if isinstance(explosion, PaperExplosionParameters):
        cost = _published(modules, module_named(request.module), explosion, parameters.playback)
    elif explosion is None:
        cost = _direct(modules, parameters.playback)
    else:
        cost = _ours(modules, request, parameters)
    times = 2.0 if request.refold else 1.0  # the first shape is unfolded, too
    return replace(cost, expected_s=min(MAX_EXPECTED_S, times * cost.expected_s))


def _published(
    modules: int,
    module: Module,
    explosion: PaperExplosionParameters,
    playback: PlaybackParameters,
) -> ExpectedCost:
    """Return the cost of a fold as published, with any settings."""
    # Measured with 64 modules, and fitted to those of 160: docs/reproduction.md.
    usual = 80_000.0 * (modules / 64) ** 0.27
    slower = growth_of_step(PaperExplosionParameters(), module) / max(
        growth_of_step(explosion, module),
        1e-12,  # no division by 0 without forces
    )
    steps = usual * slower
    packed = steps > explosion.max_steps
    exploding_s = (
        min(steps, explosion.max_steps) * modules * (PACKED_STEP_S if packed else LOOSE_STEP_S)
    )
    playing = steps / explosion.snapshot_interval * max(1, playback.steps_per_snapshot)
    simulated = _is_simulated(modules, playback)
    playing_s = simulated * min(playing, playback.max_steps) * modules * SERVO_STEP_S
    least_s = {
        "explode": LOWER_BOUND_FRACTION * steps * modules * LOOSE_STEP_S,
        "play_back": LOWER_BOUND_FRACTION * simulated * playing * modules * SERVO_STEP_S,
    }
    stage = max(least_s, key=lambda name: least_s[name])
    return ExpectedCost(
        expected_s=expected_seconds(modules) + exploding_s + playing_s,
        least_s=least_s[stage],
        stage=stage,
        cause=f"a fold of {modules} modules that needs about {steps:.2g} steps to explode and "
        f"{playing:.2g} steps to fold",
        remedy="Use fewer modules, a larger step_s, larger gains of the explosion, or less damping."
        if stage == "explode"
        else "Use fewer modules, a larger snapshot_interval, or fewer steps_per_snapshot.",
    )


def growth_of_step(explosion: PaperExplosionParameters, module: Module) -> float:
    """Return σ Δt: the growth in one step of distances that the forces drive apart.

    Distances follow ẍ + α ẋ = r x with the drag α and a rate r of the forces for each module mass
    and pitch, so σ = (√(α² + 4 r) − α) / 2.
    """
    mass = explosion.module_mass_g(module)
    rate = (
        explosion.radial_gain / explosion.pitch_cm
        + SHORT_RANGE_WEIGHT * explosion.repulsion_gain / explosion.pitch_cm**3
        + SHORT_RANGE_WEIGHT * explosion.spring / explosion.pitch_cm**2
    ) / mass
    drag = explosion.damping / (1.0 - explosion.damping) / explosion.step_s
    return 2.0 * rate * explosion.step_s / (math.sqrt(drag**2 + 4.0 * rate) + drag)


def _direct(modules: int, playback: PlaybackParameters) -> ExpectedCost:
    """Return the cost of servoing straight to the shape, which is simulated at any length."""
    usual = playback.step_s >= PUBLISHED_PLAYBACK.step_s
    steps = playback.direct_steps + 500 if usual else playback.max_steps
    return ExpectedCost(
        expected_s=expected_seconds(modules) + steps * modules * 30e-6,  # measured: 14 to 45 µs
        least_s=playback.direct_steps * modules * SERVO_STEP_S,
        stage="play_back",
        cause=f"{modules} modules with the preset 'direct'",
        remedy="Use fewer modules, or the preset 'default'.",
    )


def _ours(modules: int, request: FoldRequest, parameters: Parameters) -> ExpectedCost:
    """Return the cost of a fold by foldback's own method."""
    choosing = request.prefer != COMPUTING
    usual_s = expected_seconds(modules, choosing=choosing, world=request.world)
    robots_s = _robots_s(modules, parameters.playback)
    usual_robots_s = _robots_s(modules, DEFAULT_PARAMETERS.playback)
    expected_s, least_s = (
        usual_s + max(0.0, robots_s - usual_robots_s),
        LOWER_BOUND_FRACTION * robots_s,
    )
    stage, cause = "play_back", f"{modules} modules and {parameters.playback.robot.robots} robots"
    remedy = "Use fewer robots, or a lower value of simulated_modules."
    if request.world != FLOATING and LOWER_BOUND_FRACTION * usual_s > least_s:
        least_s, stage, cause = (
            LOWER_BOUND_FRACTION * usual_s,
            "explode",
            f"{modules} modules on a table",
        )
        remedy = "Use fewer modules, or the 'floating' world."
    strategy = request.strategy
    if request.smooth:
        expected_s += smoothing_seconds(modules)
    elif strategy in COSTS_INTERLOCKED:
        expected_s += COSTS_INTERLOCKED[strategy].of(modules)
        if (
            lower_bound_s := LOWER_BOUND_FRACTION * COSTS_IN_LAYERS[strategy].of(modules)
        ) > least_s:
            least_s, stage = lower_bound_s, "explode"
            cause = f"{modules} modules with the strategy '{strategy}'"
            remedy = "Use fewer modules, or the strategy 'auto'."
    return ExpectedCost(
        expected_s=expected_s, least_s=least_s, stage=stage, cause=cause, remedy=remedy
    )


def _is_simulated(modules: int, playback: PlaybackParameters) -> bool:
    """Return True if a playback is likely to be simulated, peeled chains having most frames."""
    limit, robots = playback.simulated_modules, playback.robot.robots
    return is_simulated(
        modules, int(2.5 * modules), limit, robots, is_windowed=modules > USUALLY_PEELED_MODULES
    )


def _robots_s(modules: int, playback: PlaybackParameters) -> float:
    """Return the processor time of a playback that robots with faults are simulated in."""
    if not _is_simulated(modules, playback):
        return 0.0
    robots = max(1, playback.robot.robots)
    if playback.robot.engine == MUJOCO:
        return robots * mujoco_seconds(2 * modules, 3 * modules)  # 505 steps for 160 modules
    linear_s, square_s = 3.5e-3, 9e-6  # measured: 0.7 s for 160 modules, 12 s for 1000
    return robots * (linear_s * modules + square_s * modules**2)
