"""Verdicts on figures in words: whether turns lead to a figure, and at which size."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TypedDict

from foldback.planner.chain.module import Module, ModuleWords
from foldback.planner.errors import UNREADABLE, PlannerError
from foldback.planner.pipeline.fold_layout import judged_module, lacks_verdict, stored_verdict
from foldback.planner.reachability.verdict_figures import (
    ExhaustionFigures,
    SequenceFigures,
    VerdictFigures,
)
from foldback.planner.storage.file_names import CHAIN, VERDICT_FILES
from foldback.planner.verification.integrity import damaged_among
from foldback.words.fold import ShownFold

CHECK_HINT = (
    "Another program checks the proof in this file: python foldback_check_exhaustion.py {file}"
)


class FullSize(TypedDict):
    """Whether turns at full size lead to the figure of a fold, on its page.

    Attributes:
        text: The verdict; empty while it is computed.
        has_proof: True if a file proves that single turns do not lead there.
        hint: Largest size for which turns are known, if a failed fold asked for more; or empty.
    """

    text: str
    has_proof: bool
    hint: str


def full_size(row: ShownFold, directory: Path, derived_dir: Path) -> FullSize | None:
    """Return the verdict on the figure of a fold; None if its figure gets none.

    Args:
        row: The fold, which is over.
        directory: Directory of the fold.
        derived_dir: Directory of the verdict.
    """
    try:
        module = judged_module(directory)
        awaited = module is not None and derived_dir == directory and lacks_verdict(directory)
    except (PlannerError, *UNREADABLE):  # reported where the files are read
        return None
    if module is None or damaged_among(directory, (CHAIN, *VERDICT_FILES)):
        return None
    verdict = None if awaited else stored_verdict(derived_dir)
    if verdict is None:
        return {"text": "", "has_proof": False, "hint": ""}
    lines = verdict_lines(verdict, module)
    if verdict.at_full_size is None:  # full size first
        lines.reverse()
    requested_size = row.module_size or module.default_size
    hint = size_hint(verdict, module.words, requested_size) if row.status == "failed" else ""
    return {"text": " ".join(lines), "has_proof": verdict.exhaustion is not None, "hint": hint}


def size_hint(verdict: VerdictFigures, words: ModuleWords, requested_size: float) -> str:
    """Return the largest size for which turns are known; empty if no more was asked for."""
    sequence = verdict.at_full_size or verdict.smaller
    if sequence is None or sequence.size >= requested_size:
        return ""
    return (
        f"Turns are known only for {words.plural} of up to {size_text(sequence.size)} of the full "
        f"size, but this fold asked for {requested_size:g}."
    )


def size_text(size: float) -> str:
    """Return a size that is not above the given one: 0.8062 for 0.80627."""
    return f"{math.floor(size * 1e4 + 1e-6) / 1e4:g}"


def verdict_lines(verdict: VerdictFigures, module: Module) -> list[str]:
    """Return the verdict, the most important first, a sentence on each line.

    Args:
        verdict: The verdict.
        module: The module of the chain.
    """
    words, step_deg = module.words, math.degrees(module.pieces[0].step_rad or 0.0)
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


def _turns(sequence: SequenceFigures, turn: str) -> str:
    return f"{sequence.turns} {turn}{'' if sequence.turns == 1 else 's'}"


def _exhaustion(proof: ExhaustionFigures, modules: int, words: ModuleWords, turn: str) -> str:
    first, last, states = proof.first + 1, proof.first + proof.modules, proof.states
    part = f"{words.plural} {first} to {last}"
    lead = f"No sequence of single {turn}s leads there at full size"
    if states == 1:
        which = "no joint" if proof.modules == modules else f"between {part} no joint"
        return f"{lead}, which is proved: {which} can make a single {turn}."
    which = "the whole chain" if proof.modules == modules else f"the joints between {part}"
    return f"{lead}, which is proved: all {states} states that {which} can reach were tried."
