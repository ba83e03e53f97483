"""Telling: what the runs say, as the page and the document show it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

from planner.paper_settings import SETTINGS
from planner.parameters import preset
from tests.benchmarks.reproduction.experiments import (
    STATEMENTS,
    Experiment,
    Statement,
)
from tests.benchmarks.reproduction.runs import Phase, Run

FORMAT: Final = "foldback-reproduction/1"
NONE: Final = "–"
THIN: Final = "\u2009"
HEAD: Final = (
    "Fold",
    "Verdict",
    "Steps",
    "Simulated",
    "Wall (processor)",
    "End error",
    "Clearance (proved)",
    "Largest lag",
    "Snapshots",
    "Files",
)
UNITS: Final = {
    "Steps": "explosion + playback",
    "Simulated": "explosion + playback, seconds",
    "Wall (processor)": "seconds, of all stages",
    "End error": "RMS, pitches",
    "Clearance (proved)": "of the simulated playback, pitches, modules of 0.95",
    "Largest lag": "of a hinge behind its target, rad",
    "Snapshots": "of the explosion",
    "Files": "MB",
}
PUBLISHED_SECONDS: Final = 0.01
"""Of a step."""
SOURCES: Final = {
    "published": "published",
    "named": "named, without a number",
    "ours": "not in the paper",
}
ASIDE: Final = (
    "The paper's simulations ran on the Open Dynamics Engine, these run on MuJoCo: contacts, "
    "friction, stops and motors are other models of the same things.",
    "Its program, its recordings and its video were not at hand. What it does not tell was chosen "
    "so that its folds work, and is marked so above.",
    "It tells no wall times, clearances or joint errors, so ours stand alone.",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """One experiment as it is seen.

    Attributes:
        id, title: Of it.
        modules: Of its chain; 0 when it has not been run.
        tone: ``good``, ``bad`` or ``none`` when it has not been run.
        verdict: In a few words.
        why: Of a fold that failed, in a line.
        film: Whether there is one.
        stuck_frame: Frame of the film where it fails; None when it does not.
        stuck: Modules there.
        strip, straight: Whether there are these pictures as well.
    """

    id: str
    title: str
    modules: int
    tone: str
    verdict: str
    why: str
    film: bool
    stuck_frame: int | None
    stuck: tuple[int, ...]
    strip: bool
    straight: bool


def told(runs: Mapping[str, Run], every: tuple[Experiment, ...]) -> dict[str, Any]:
    """All that page and document show, as plain JSON values.

    Args:
        runs: What there is, by the id of the experiment.
        every: All experiments.
    """
    asked = {one.id: one.asked for one in every}
    runs = {name: run for name, run in runs.items() if run.asked == asked.get(name)}
    return {
        "format": FORMAT,
        "machine": _machine(runs),
        "summary": _summary(every, runs),
        "head": [{"name": name, "unit": UNITS.get(name, "")} for name in HEAD],
        "sections": [_section(statement, every, runs) for statement in STATEMENTS],
        "settings": _settings(),
        "differences": [*_differences(every, runs), *ASIDE],
    }


def _section(
    statement: Statement, every: tuple[Experiment, ...], runs: Mapping[str, Run]
) -> dict[str, Any]:
    own = [one for one in every if one.statement == statement.id]
    rows = [_row(one, runs.get(one.id)) for one in own]
    published = sorted({one.published_steps for one in own if one.published_steps})
    for steps in published:
        row = ["Published", "folds", f"about {whole(steps)}", seconds(steps * PUBLISHED_SECONDS)]
        rows.insert(0, row + [NONE] * (len(HEAD) - len(row)))
    return {
        "id": statement.id,
        "heading": statement.heading,
        "where": statement.where,
        "quote": statement.quote,
        "words": statement.words,
        "pairs": [list(pair) for pair in statement.pairs if all(one in runs for one in pair)],
        "cards": [asdict(card_of(one, runs.get(one.id))) for one in own],
        "rows": rows,
    }


def card_of(one: Experiment, run: Run | None) -> Card:
    """An experiment as it is seen."""
    film = run is not None and run.frames > 0
    return Card(
        id=one.id,
        title=one.title,
        modules=0 if run is None else run.modules,
        tone="none" if run is None else "good" if run.verified else "bad",
        verdict=verdict(run),
        why="" if run is None or run.verified else why(run),
        film=film,
        stuck_frame=None if run is None else run.stuck_frame,
        stuck=() if run is None else run.overlap.modules if run.overlap else run.stuck,
        strip=film and one.strip,
        straight=film and one.straight,
    )


def verdict(run: Run | None) -> str:
    """In a word or two."""
    if run is None:
        return "not run yet"
    if run.verified:
        return run.verdict
    if run.verdict.startswith("refused"):
        return "refused"
    if run.overlap is not None:
        return "tangles"
    if run.playback is None:
        return "does not unfold"
    return "not verified" if run.playback.status == "folded" else "does not arrive"


def why(run: Run) -> str:
    """Of a fold that failed, in a line."""
    if (place := run.overlap) is None:
        return run.verdict.partition(": ")[2]
    a, b = place.modules
    where = "" if place.of == "playback" else " in the plan"
    return (
        f"modules {a} and {b} overlap by {figure(place.depth)} pitch{where}, "
        f"{round(100 * place.share)} % into the fold"
    )


def _row(one: Experiment, run: Run | None) -> list[str]:
    if run is None:
        return [one.title, verdict(None), *[NONE] * (len(HEAD) - 2)]
    clearance = run.clearance_playback if run.clearance_playback is not None else None
    proved = f" ({figure(run.bound)})" if run.bound is not None and run.verified else ""
    return [
        one.title,
        verdict(run),
        _both(run.explosion, run.playback, lambda phase: whole(phase.steps)),
        _both(run.explosion, run.playback, lambda phase: seconds(phase.simulated_s)),
        f"{run.wall_s:.1f} ({run.processor_s:.1f})",
        NONE if run.rms is None else figure(run.rms),
        NONE if clearance is None else figure(clearance) + proved,
        NONE if run.lag_rad is None else figure(run.lag_rad),
        NONE if run.explosion is None else whole(run.explosion.frames),
        f"{run.folder_mb:.1f}",
    ]


def _both(explosion: Phase | None, playback: Phase | None, told: Any) -> str:
    return " + ".join(told(phase) for phase in (explosion, playback) if phase) or NONE


def _summary(every: tuple[Experiment, ...], runs: Mapping[str, Run]) -> list[str]:
    """What has come out, in sentences that hold for the runs that there are."""
    found: list[str] = []
    for name, one in (("wrench-160", "wrench of 160"), ("mallet-160", "mallet of 160")):
        run = runs.get(name)
        if run is not None and run.explosion and run.playback and run.verified:
            found.append(
                f"The {one} folds by the published method in "
                f"{whole(run.explosion.steps + run.playback.steps)} steps and "
                f"{run.wall_s:.0f} s, and ends {figure(run.rms or 0.0)} pitch from its shape."
            )
    for published, words in (
        ("verified", "folds that the paper tells of fold here too"),
        ("tangled", "attempts that fail in the paper fail here too"),
    ):
        of = [one for one in every if one.published == published and one.id in runs]
        same = sum(runs[one.id].verified == (published == "verified") for one in of)
        if of:
            found.append(f"{same} of {len(of)} {words}.")
    missing = len(every) - len(runs)
    if missing:
        found.append(f"{missing} of {len(every)} experiments have not been run yet.")
    return found


def _differences(every: tuple[Experiment, ...], runs: Mapping[str, Run]) -> list[str]:
    """Where an experiment came out otherwise than in the paper, or did not work."""
    found: list[str] = []
    for one in every:
        run = runs.get(one.id)
        if run is None:
            continue
        if one.published == "tangled" and run.verified:
            found.append(f"{one.title} by direct servoing: tangled in the paper, verified here.")
        elif one.published == "verified" and not run.verified:
            found.append(f"{one.title}: folds in the paper; here it {_failed(run)}.")
        elif one.published is None and not run.verified:
            found.append(f"{one.title} ({_section_of(one)}): it {_failed(run)}.")
    return found


def _failed(run: Run) -> str:
    return f"{verdict(run)}, {why(run)}"


def _section_of(one: Experiment) -> str:
    (found,) = (s.heading for s in STATEMENTS if s.id == one.statement)
    return found[0].lower() + found[1:]


def _machine(runs: Mapping[str, Run]) -> str:
    """Where the times were taken."""
    if not runs:
        return ""
    cores = sorted({run.cores for run in runs.values()})
    names = sorted({run.processor for run in runs.values()})
    reference = [run.reference_s for run in runs.values()]
    return (
        f"Times are of {' and '.join(str(n) for n in cores)} cores of {' and '.join(names)}, where "
        f"1000 steps of one tree of 160 cubes took {min(reference):.2f} to {max(reference):.2f} s "
        "just before each run."
    )


def _settings() -> list[dict[str, str]]:
    parameters = preset("paper")
    return [
        {
            "label": setting.label,
            "name": setting.name,
            "value": "none" if (value := setting.default(parameters)) is None else figure(value),
            "unit": "" if value is None else setting.unit,
            "source": SOURCES[setting.source],
            "meaning": setting.meaning,
        }
        for setting in SETTINGS
    ]


def whole(number: int) -> str:
    """With thin spaces between thousands."""
    return f"{number:,}".replace(",", THIN)


def seconds(value: float) -> str:
    """Of simulated time."""
    return whole(round(value)) if value >= 100.0 else f"{value:.1f}"


def figure(value: float) -> str:
    """Two digits that count; what rounding leaves of nothing is nothing."""
    size = abs(value)
    if size < 1e-9:
        return "0"
    if size >= 100.0:
        return whole(round(value)).replace("-", "−")
    digits = max(0, 1 - math.floor(math.log10(size)))
    text = f"{value:.{digits}f}"
    return (text.rstrip("0").rstrip(".") if "." in text else text).replace("-", "−")
