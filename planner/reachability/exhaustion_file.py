"""``foldback-exhaustion/1``: the proof that no single turns lead to a figure, for another program.

``foldback_check_exhaustion.py``, which needs nothing of foldback, checks such files.
"""

from __future__ import annotations

import json
from typing import Any, Final

from foldback.planner.chain.module import Module
from foldback.planner.core.structures import Levels, TurnTable
from foldback.planner.reachability.verdict import Exhaustion
from foldback.planner.turns.hinge_steps import FULL_SIZE, HingeSteps

EXHAUSTION_FORMAT: Final = "foldback-exhaustion/1"
BLOCKED: Final = -1
BEYOND_STOP: Final = -2


def write_exhaustion(
    module: Module, exhaustion: Exhaustion, *, figure: Levels, goal: Levels
) -> bytes:
    """Return the file of a proof.

    Args:
        module: The kind of module.
        exhaustion: The proof.
        figure, goal: (J,) levels of the whole chain.
    """
    steps = HingeSteps(module, exhaustion.modules, first=exhaustion.first)
    table = steps.table(exhaustion.states, FULL_SIZE)
    values = {
        "format": EXHAUSTION_FORMAT,
        "module": module.document,
        "modules": module.module_count(len(figure)),
        "figure": figure.tolist(),
        "goal": goal.tolist(),
        "part": {"first": exhaustion.first, "modules": exhaustion.modules},
        "states": exhaustion.states.tolist(),
        "turns": _turns(table, exhaustion.first),
    }
    return (json.dumps(values, separators=(",", ":")) + "\n").encode()


def _turns(table: TurnTable, first: int) -> list[list[list[Any]]]:
    """Return what each turn of each state leads to, hinge by hinge, back and forward.

    That is the number of a state, None beyond a stop, or two modules of the whole chain and the
    share of the turn at which they overlap.
    """
    columns = (table.next.tolist(), table.modules.tolist(), table.places.tolist())
    return [
        [
            [
                _leads_to(number, pair, place, first)
                for number, pair, place in zip(*hinge, strict=True)
            ]
            for hinge in zip(*state, strict=True)
        ]
        for state in zip(*columns, strict=True)
    ]


def _leads_to(number: int, pair: list[int], place: float, first: int) -> Any:
    if number == BEYOND_STOP:
        return None
    return number if number >= 0 else [first + pair[0], first + pair[1], place]
