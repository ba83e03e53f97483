"""Strategies: the ways in which a folded chain is released.

``simultaneous`` is the paper's: all modules at once. ``blocks`` lets rigid blocks come apart first.
``peel`` releases one unit after the other from the chain's far end, so its cost grows linearly.
``turns`` and ``one-by-one`` need no explosion: they search for quarter turns, and make some at
once, or one after the other. ``auto`` folds a short chain in turns if they are as clear as an
explosion; otherwise it chooses by size and path, and explodes all modules calmly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final, TypeVar

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError
from foldback.planner.explosion.blocks_first import explode_blocks_first
from foldback.planner.explosion.peeling.peeling import peel
from foldback.planner.explosion.published_explosion import explode_as_published
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.explosion.strategy_cost import by_cost
from foldback.planner.explosion.table.table_explosion import explode_on_table
from foldback.planner.explosion.turning import MAX_TURNING_MODULES, unfold_in_turns
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.explosion import MUJOCO, ExplosionParameters, PeelingParameters
from foldback.planner.parameters.parameters import (
    AUTO,
    BASELINE,
    MAX_AUTO_TURNING_MODULES,
    STRATEGY_CHOICES,
    TURNS,
    Parameters,
    unknown_strategy,
)
from foldback.planner.parameters.published import PaperExplosionParameters
from foldback.planner.pathfinding.removal_analysis import analyse_removal
from foldback.planner.progress import Cancelled, Report, never, silent
from foldback.planner.simulation.mujoco_chain import refuse_long_chain
from foldback.planner.turns.step_turning import MAX_WORK, turns_in_steps
from foldback.planner.turns.turn_sequence import LATTICE_TURNINGS

BLOCKS_FROM_MODULES: Final = 160
"""Minimum number of modules of a chain for which ``auto`` tries the strategy ``blocks``, which
unfolds rigid blocks of 64 or more modules first. Larger values leave more chains to the other
strategies: docs/decisions/0015-hard-paths.md."""

_Forces = TypeVar("_Forces", ExplosionParameters, PeelingParameters)


def ranked_strategies(
    chain: Chain, parameters: Parameters, *, refolds: bool = False
) -> tuple[str, ...]:
    """Return the strategies that a fold's settings allow, the best first.

    Args:
        chain: The chain.
        parameters: Parameters of the fold, with the strategy that was asked for.
        refolds: True if the chain begins folded otherwise: its motion is then one simulation.

    Raises:
        InputError: ``unknown-strategy``, or ``strategy-differs`` for one that this chain, preset or
            refold cannot have; ``too-long-for-mujoco`` or ``mujoco-on-table``.
    """
    wished = parameters.strategy
    if wished not in STRATEGY_CHOICES:
        raise unknown_strategy(wished)
    possible = _possible(chain, parameters, refolds)
    if _is_by_mujoco(parameters):
        refuse_long_chain(chain)
        if parameters.world == "table":
            raise InputError(
                "mujoco-on-table",
                "got engine=mujoco for a fold on a table, expected the 'floating' world; leave out "
                "engine=mujoco.",
            )
    if not possible:
        raise InputError(
            "unsuited-world",
            f"got a chain of {chain.module.words.plural} for a fold on a table, expected modules "
            "that fold along any path of cells; use the 'floating' world.",
        )
    if wished == AUTO:
        return tuple(name for name in _preferred(chain) if name in possible) or possible[:1]
    if wished not in possible:
        raise InputError(
            "strategy-differs",
            f"got the strategy {wished}, expected one of: auto, {', '.join(possible)}. "
            f"{_limitation(chain, parameters, refolds)}",
        )
    return (wished,)


def takes_turns(chain: Chain, parameters: Parameters, *, refolds: bool = False) -> bool:
    """Return True if ``auto`` looks for turns with the most room before it explodes a chain.

    Args:
        chain: The chain.
        parameters: Parameters of the fold.
        refolds: True if the chain begins folded otherwise.
    """
    return (
        parameters.strategy == AUTO
        and parameters.world != "table"
        and parameters.module_size == Parameters().module_size
        and _has_own_explosion(parameters)
        and not refolds
        and len(chain) <= MAX_AUTO_TURNING_MODULES
        and on_lattice(chain)
    )


def _limitation(chain: Chain, parameters: Parameters, refolds: bool) -> str:
    """Say why a strategy is not defined for a chain."""
    wished, floats = parameters.strategy, parameters.world != "table"
    if _is_by_mujoco(parameters) and wished in ("blocks", "peel"):
        return "With engine=mujoco, MuJoCo simulates all modules at once."
    if wished not in (TURNS, BASELINE) or not _has_own_explosion(parameters) or not floats:
        return (
            f"Only these can {'refold' if refolds else 'fold'} modules of the type "
            f"{chain.module.name} with the preset {parameters.preset}."
        )
    if len(chain) > MAX_TURNING_MODULES:
        return f"It folds at most {MAX_TURNING_MODULES} modules; this chain has {len(chain)}."
    hinge = int(np.argmax(_off_square(chain)))
    degrees = float(np.rad2deg(chain.folded_rad[hinge]))
    return f"It folds only hinges at −90°, 0° or 90°; hinge {hinge} here is at {degrees:g}°."


def alternative_strategies(
    chain: Chain, parameters: Parameters, *, refolds: bool = False, turns: bool = False
) -> tuple[str, ...]:
    """Return the strategies whose plans may be better than a verified one, best guess first.

    Unless one strategy was asked for, these are all explosions: a plan that moves more joints at a
    time folds faster, with less torque in a given time, and keeps more clearance.

    Args:
        chain: The chain.
        parameters: Parameters of the fold, with the strategy that was asked for.
        refolds: True if the chain begins folded otherwise.
        turns: True if the hinges are to move as little as possible, so that turns come first.
    """
    if parameters.strategy != AUTO:
        return ranked_strategies(chain, parameters, refolds=refolds)
    possible = _possible(chain, parameters, refolds)
    explosions = tuple(name for name in possible if name not in (TURNS, BASELINE))
    return (TURNS, *explosions) if turns and TURNS in possible else explosions


def _possible(chain: Chain, parameters: Parameters, refolds: bool) -> tuple[str, ...]:
    """Return all strategies that are defined for a chain."""
    if parameters.world == "table":
        return ("peel",) if on_lattice(chain) else ()
    if not _has_own_explosion(parameters):
        return ("simultaneous",)  # as published, or nothing at all
    may_turn = len(chain) <= MAX_TURNING_MODULES and _turns(chain)
    turns = (TURNS, BASELINE) if may_turn else ()
    names = ("simultaneous", "blocks", "peel") if on_lattice(chain) else ("simultaneous",)
    if _is_by_mujoco(parameters):
        names = ("simultaneous",)
    names = (*names, *turns)
    return tuple(n for n in names if not (refolds and records_windows(n)))


def _preferred(chain: Chain) -> tuple[str, ...]:
    """Return the strategies for a chain, the best first."""
    if chain.module.filling not in LATTICE_TURNINGS and _turns(chain):
        # Turns of several hinges at once begin with the search for single turns, which costs the
        # more, the more parts there are: docs/decisions/0066-turns-by-steps.md.
        one_part = all(len(piece.parts) == 1 for piece in chain.module.pieces)
        return (BASELINE, TURNS, "simultaneous") if one_part else (BASELINE, "simultaneous")
    if not on_lattice(chain):
        return ("simultaneous",)
    modules = len(chain)
    cells = np.rint(chain.folded_poses.positions).astype(np.int64)
    ways = by_cost(modules, in_layers=analyse_removal(cells).free)
    if modules < BLOCKS_FROM_MODULES:
        return tuple(way for way in ways if way != "blocks")
    return ways


def on_lattice(chain: Chain) -> bool:
    """Return True if a chain follows a path through the cells of the cubic lattice."""
    return _square(chain) and chain.module.follows_paths


def _is_by_mujoco(parameters: Parameters) -> bool:
    """Return True if MuJoCo computes the motion of all modules of a chain at once."""
    return parameters.playback.robot.engine == MUJOCO


def _has_own_explosion(parameters: Parameters) -> bool:
    """Return False for an explosion as published, or none at all."""
    return isinstance(parameters.explosion, ExplosionParameters)


def _square(chain: Chain) -> bool:
    """Return True if all hinges of a folded chain are straight or at right angles."""
    return bool((_off_square(chain) < 1e-4).all())


def _turns(chain: Chain) -> bool:
    """Return True if a chain may fold in turns: its hinges are at whole steps."""
    return _square(chain) if chain.module.filling in LATTICE_TURNINGS else turns_in_steps(chain)


def _off_square(chain: Chain) -> Array:
    """Return (J,) differences of all folded angles from multiples of 90°, as fractions of 90°."""
    quarters = chain.folded_rad / (np.pi / 2)
    return np.abs(quarters - np.rint(quarters))


def run_strategy(
    chain: Chain,
    strategy: str,
    parameters: Parameters,
    *,
    seed: int = 0,
    gentle: bool = False,
    calm: bool = False,
    roomy: bool = False,
    sink: Callable[[Motion], None] | None = None,
    progress: Report = silent,
    cancelled: Cancelled = never,
) -> Record:
    """Release a folded chain by one of the strategies and record its motion.

    Args:
        chain: The chain, starting in its folded configuration.
        strategy: One of ``STRATEGY_CHOICES`` except ``auto``.
        parameters: Parameters of the fold.
        seed: Seed of all random numbers.
        gentle: True for half the tension, and steps that bring modules half as near.
        calm: True if an explosion of all modules is to make few detours.
        roomy: True for turns with the most room alone, in few steps.
        sink: Receives the snapshots as they are made: windowed if ``windowed`` says so.
        progress: Receives the progress, a few times a second.
        cancelled: Returns True to stop; called every few steps.
    """
    options = parameters.explosion
    if isinstance(options, PaperExplosionParameters):
        return explode_as_published(
            chain, options, sink=sink, progress=progress, cancelled=cancelled
        )
    if options is None:
        raise InputError(
            "no-explosion",
            f"got the preset {parameters.preset!r}, which folds without an explosion, expected a "
            "preset with an explosion.",
        )
    if strategy in (TURNS, BASELINE):
        return unfold_in_turns(
            chain,
            strategy,
            module_size=parameters.module_size,
            at_once=1 if strategy == BASELINE else parameters.at_once,
            seed=seed,
            roomy=roomy,
            max_work=MAX_WORK if parameters.strategy == AUTO else 0,
            sink=sink,
            cancelled=cancelled,
        )
    if parameters.world == "table":
        on_it = replace(parameters.table, verify_size=parameters.module_size)
        return explode_on_table(
            chain, on_it, seed=seed, sink=sink, progress=progress, cancelled=cancelled
        )
    if strategy == "peel":
        finer = _suited(parameters.peeling, parameters.module_size, gentle)
        return peel(chain, finer, seed=seed, sink=sink, progress=progress, cancelled=cancelled)
    options = _suited(options, parameters.module_size, gentle)
    if strategy == "blocks":
        return explode_blocks_first(
            chain, options, seed=seed, sink=sink, progress=progress, cancelled=cancelled
        )
    return explode(
        chain,
        options,
        seed=seed,
        calm=calm,
        sink=sink,
        progress=progress,
        cancelled=cancelled,
    )


def _suited(parameters: _Forces, module_size: float, gentle: bool) -> _Forces:
    """Return the parameters for the size to verify, with half the force if ``gentle``."""
    share = 0.5 if gentle else 1.0
    return replace(
        parameters,
        verify_size=max(parameters.verify_size, module_size),
        tension=share * parameters.tension,
        pair_cap=share * parameters.pair_cap,
        pair_cap_loose=share * parameters.pair_cap_loose,
    )


def records_windows(strategy: str) -> bool:
    """Return True if a strategy's snapshots are windowed."""
    return strategy == "peel"
