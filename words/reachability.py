"""Verdicts on figures in words: whether turns lead to a figure, and at which size."""

from __future__ import annotations

import math

from foldback.planner.chain.module import ModuleWords
from foldback.planner.reachability.verdict import Exhaustion, Sequence, Verdict

CHECK_HINT = (
    "Another program checks the proof in this file: python foldback_check_exhaustion.py {file}"
)


def size_text(size: float) -> str:
    """Return a size that is not above the given one: 0.8062 for 0.80627."""
    return f"{math.floor(size * 1e4 + 1e-6) / 1e4:g}"


def verdict_lines(verdict: Verdict, words: ModuleWords, step_deg: float) -> list[str]:
    """Return the verdict, the most important first, a sentence on each line.

    Args:
        verdict: The verdict.
        words: What people call the modules.
        step_deg: Step of the joints.
    """
    turn = {90.0: "quarter turn", 180.0: "half turn"}.get(round(step_deg, 6), "turn")
    full, smaller = verdict.at_full_size, verdict.smaller
    lines: list[str] = []
    if verdict.kind == "one-joint" and full is not None:
        lines.append(f"One joint at a time leads there: {_turns(full, turn)}.")
    elif full is not None:
        lines.append(
            f"Several joints at once lead there: {_turns(full, turn)} in {full.moves} moves."
        )
    elif smaller is not None:
        most = "at most " if verdict.is_largest else ""
        lines.append(
            f"One joint at a time leads there with smaller {words.plural}, of {most}"
            f"{size_text(smaller.size)} of the full size: {_turns(smaller, turn)}."
        )
    if verdict.exhaustion is not None:
        lines.append(_exhaustion(verdict.exhaustion, verdict.modules, words, turn))
    elif verdict.kind != "one-joint":
        lines.append(
            f"No sequence of single {turn}s at full size was found; {verdict.tried} turns in "
            f"{verdict.states} states were tried, but not all that there are."
        )
    if full is not None and smaller is not None:
        lines.append(
            f"One joint at a time leads there with {words.plural} of {size_text(smaller.size)} of "
            "the full size."
        )
    return lines


def _turns(sequence: Sequence, turn: str) -> str:
    return f"{sequence.turns} {turn}{'' if sequence.turns == 1 else 's'}"


def _exhaustion(proof: Exhaustion, modules: int, words: ModuleWords, turn: str) -> str:
    first, last, states = proof.first + 1, proof.first + proof.modules, len(proof.states)
    part = f"{words.plural} {first} to {last}"
    lead = f"No sequence of single {turn}s leads there at full size"
    if states == 1:
        which = "no joint" if proof.modules == modules else f"between {part} no joint"
        return f"{lead}, which is proved: {which} can make a single {turn}."
    which = "the whole chain" if proof.modules == modules else f"the joints between {part}"
    return f"{lead}, which is proved: all {states} states that {which} can reach were tried."
