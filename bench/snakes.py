"""Snakes: a verdict on each known figure of the Rubik's snake, and verified folds of them."""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from bench.sections import Section
from foldback import foldback_check_exhaustion
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.pathfinding.snake_cubes import box_cells, fold_sequence
from foldback.planner.pipeline.fold import fold, refold
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.steps import steps_of
from foldback.planner.reachability.deciding import Decider
from foldback.planner.reachability.exhaustion_file import write_exhaustion
from foldback.planner.reachability.verdict import Verdict
from foldback.planner.twist_chains.figures import known_snake_cubes, snake_figures
from foldback.planner.twist_chains.folded_chains import cube_chain, snake_chain
from foldback.words.reachability import size_text

ONE_JOINT_BAR = 33
"""Number of figures to which sampled searches of others found single turns, by their own count."""
SMALL_SIZE = 0.8
"""Size for which nearly all figures are to fold."""
SMALL_BAR = 57
"""Number of figures that are to fold at that size."""
MEDIAN_SECONDS, MAX_SECONDS = 10.0, 60.0
"""Bars of the time of a verdict, in processor seconds."""
KNOWN_EXHAUSTED = frozenset(
    ("Camel", "Compact2", "Contact", "Cross1", "Hat", "Snowman", "Windshield", "crucifix", "mask")
)
"""Figures to which no single turns lead, by others' searches."""

PAIRS = 20
"""Number of pairs of figures of which one is folded into the other."""


def snakes(reference_seconds: float) -> Section:
    """Decide for each known figure whether turns lead there, and check the proofs."""
    section = Section(name="snakes")
    verdicts: dict[str, Verdict] = {}
    for figure in snake_figures():
        chain = snake_chain(figure.code, name=figure.name)
        verdicts[figure.name] = _add_verdict(section, chain, reference_seconds)
    _add_verdicts(section, verdicts)
    _add_sizes(section, verdicts)
    times = [row["seconds"] for row in section.rows]
    for name, value, bar in (
        ("median", median(times), MEDIAN_SECONDS),
        ("most", max(times), MAX_SECONDS),
    ):
        section.add(f"seconds, {name}", f"{value:.2f}", f"at most {bar:g}", value <= bar)
    cubes = [_add_verdict(section, chain, reference_seconds) for chain in _cube_chains()]
    decided = sum(verdict.kind != "not-found" for verdict in cubes)
    section.add("snake cubes decided", f"{decided} of {len(cubes)}", "all", decided == len(cubes))
    return section


def _add_verdict(section: Section, chain: Chain, reference_seconds: float) -> Verdict:
    """Add a row with the verdict on a chain's folded shape."""
    start_s = time.process_time()
    verdict = Decider(chain.module, chain.folded_rad).verdict()
    seconds = time.process_time() - start_s
    section.rows.append(
        {"name": chain.name}
        | _row(chain, verdict)
        | {"seconds": round(seconds, 2), "ratio": round(seconds / reference_seconds, 2)}
    )
    return verdict


def _cube_chains() -> list[Chain]:
    """Return the known snake cubes, solved."""
    return [
        cube_chain(
            fold_sequence(
                cube.sequence, box_cells((cube.side, cube.side, cube.side)), max_solutions=1
            ).paths[0, 0],
            name=cube.names[0],
        )
        for cube in known_snake_cubes()
    ]


def _row(chain: Chain, verdict: Verdict) -> dict[str, Any]:
    proof, sequence, smaller = verdict.exhaustion, verdict.sequence, verdict.smaller
    return {
        "verdict": verdict.kind,
        "turns": None if sequence is None else sequence.turns,
        "moves": None if sequence is None else sequence.moves,
        "single_turns_at": size_text(
            1.0 if verdict.kind == "one-joint" else smaller.size if smaller else 0.0
        ),
        "is_largest": verdict.is_largest,
        "no_single_turns": None if proof is None else f"{len(proof.states)} of {proof.modules}",
        "proved": _is_proved(chain.module, verdict),
        "states": verdict.states,
        "tried": verdict.tried,
    }


def _is_proved(module: Module, verdict: Verdict) -> bool | None:
    """Return True if the second program proves that there are no single turns; None without."""
    if verdict.exhaustion is None:
        return None
    with TemporaryDirectory() as directory:
        path = Path(directory) / "exhaustion.json"
        path.write_bytes(
            write_exhaustion(module, verdict.exhaustion, figure=verdict.figure, goal=verdict.goal)
        )
        return foldback_check_exhaustion.check(str(path))["verdict"] == "proved"


def _add_verdicts(section: Section, verdicts: dict[str, Verdict]) -> None:
    count = len(verdicts)
    one = sum(verdict.kind == "one-joint" for verdict in verdicts.values())
    proved = [row["name"] for row in section.rows if row["proved"]]
    decided = one + len(proved)
    section.add("decided at full size", f"{decided} of {count}", f"{count}", decided == count)
    section.add(
        "one joint at a time",
        f"{one}",
        f"{ONE_JOINT_BAR}, or proofs for all others",
        one >= ONE_JOINT_BAR or decided == count,
    )
    confirmed = len(KNOWN_EXHAUSTED & set(proved))
    section.add(
        "no single turns, known before",
        f"{confirmed} of {len(KNOWN_EXHAUSTED)}",
        "all",
        confirmed == 9,
    )
    section.add("no single turns, proved", f"{len(proved)}")
    several = sum(verdict.kind == "several-joints" for verdict in verdicts.values())
    section.add("rescued by several joints at once", f"{several}")


def _add_sizes(section: Section, verdicts: dict[str, Verdict]) -> None:
    sizes = [
        1.0 if v.kind == "one-joint" else 0.0 if v.smaller is None else v.smaller.size
        for v in verdicts.values()
    ]
    small = sum(size > SMALL_SIZE for size in sizes)
    section.add(
        f"single turns at {SMALL_SIZE:.2f} of the size",
        f"{small} of {len(sizes)}",
        f"at least {SMALL_BAR}",
        small >= SMALL_BAR,
    )
    for size in (0.95, 0.9, 0.85):
        section.add(f"at {size:.2f}", f"{sum(s > size for s in sizes)} of {len(sizes)}")
    exact = sum(verdict.is_largest for verdict in verdicts.values())
    section.add("size proved to be the largest", f"{exact} of {len(sizes)}")


def snake_folds(reference_seconds: float) -> Section:
    """Fold all known figures, and refold some into others, each verified: up to an hour."""
    section = Section(name="snake-folds")
    plans: list[Plan] = []
    for figure in snake_figures():
        start_s = time.process_time()
        plan = fold(snake_chain(figure.code, name=figure.name))
        section.rows.append(_fold_row(figure.name, plan, start_s, reference_seconds))
        plans.append(plan)
    for chain in _cube_chains():
        start_s = time.process_time()
        section.rows.append(_fold_row(chain.name, fold(chain), start_s, reference_seconds))
    count = len(section.rows)
    folds = sum(row["verified"] for row in section.rows)
    section.add("folds, verified", f"{folds} of {count}", "all", folds == count)
    rows: list[dict[str, Any]] = []
    for number in range(PAIRS):  # a figure, and the one half a list further on
        first, second = plans[number], plans[(number + len(plans) // 2) % len(plans)]
        start_s = time.process_time()
        plan = refold(first, second.chain)
        name = f"{first.chain.name} → {second.chain.name}"
        rows.append(_fold_row(name, plan, start_s, reference_seconds))
    section.rows += rows
    pairs = sum(row["verified"] for row in rows)
    section.add("from one to another, verified", f"{pairs} of {PAIRS}", "all", pairs == PAIRS)
    return section


def _fold_row(name: str, plan: Plan, start_s: float, reference_seconds: float) -> dict[str, Any]:
    seconds, certificate = time.process_time() - start_s, plan.certificate
    bound = certificate.clearance_bound
    return {
        "name": name,
        "verified": certificate.verified,
        "reason": None if certificate.reason is None else certificate.reason.code,
        "steps": len(steps_of(plan).steps),
        "size": certificate.module_size,
        "bound": None if bound is None else round(bound, 4),
        "seconds": round(seconds, 2),
        "ratio": round(seconds / reference_seconds, 2),
    }
