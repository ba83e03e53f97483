"""Page text: the results of the runs as texts of the page and the document."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from itertools import chain
from typing import Any, Final

from bench.ode.texts import page_section
from bench.reproduction.experiments import (
    STATEMENTS,
    Experiment,
    Statement,
)
from bench.reproduction.number_text import figure, seconds, whole
from bench.reproduction.runs import Phase, Run
from foldback.planner.parameters.parameters import preset
from foldback.planner.parameters.settings_text import SETTINGS, value_of
from foldback.words.messages import reason_text

FORMAT: Final = "foldback-reproduction/1"
"""Format of the page's data."""
NONE: Final = "–"
"""Text for a missing value."""
COLUMNS: Final = (
    "Fold",
    "Verdict",
    "Steps",
    "Simulated",
    "Wall time (processor time)",
    "End error",
    "Clearance (proved)",
    "Largest lag",
    "Files",
)
"""Columns of the tables."""
UNITS: Final = {
    "Steps": "explosion + playback",
    "Simulated": "explosion + playback, seconds",
    "Wall time (processor time)": "seconds, of all stages",
    "End error": "root mean square, pitches",
    "Clearance (proved)": "smallest gap in the simulated playback (proved lower bound), pitches; "
    "modules 0.95 pitch wide",
    "Largest lag": "of a hinge behind its target, rad",
    "Files": "MB",
}
"""Units and definitions of columns."""
MIN_SHOWN_ERROR_PITCH: Final = 1e-4
"""Smallest deviation of a folded chain from its shape that is written as a number, in pitches;
smaller ones are written as less than this value. A smaller value would state rounding errors as
results."""
PUBLISHED_STEP_S: Final = 0.01
"""Simulated time of one time step of the published algorithm, in s: section 4 of the paper that
docs/reproduction.md names states 160 000 steps as 1600 s. It converts the published numbers of
steps to times, for comparison."""
BUSY_TIME_RATIO: Final = 1.5
"""Ratio of the slowest to the fastest duration of the reference simulation before the runs, above
which the text says that the machine was also doing other work."""
SOURCES: Final = {
    "published": "published",
    "named": "named, but without a number",
    "ours": "not in the paper",
}
"""Text for each source of a parameter."""
GENERAL_DIFFERENCES: Final = (
    "The paper's simulations ran on the Open Dynamics Engine (ODE); apart from the comparison on "
    "ODE, ours run on MuJoCo. Contacts, friction, stops and motors are modelled differently.",
    "We had neither the paper's program nor its recordings or video. Where the paper states no "
    "value, we chose one with which the paper's folds work. The table above marks the values that "
    "we chose.",
    "The paper states no wall times, clearances or joint errors. The comparison on ODE shows those "
    "of our own program.",
)
"""General differences from the paper."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Card:
    """One experiment as the page shows it.

    Attributes:
        id, title: Id and title of the experiment.
        modules: Number of modules of its chain; 0 if it has not been run.
        tone: ``good``, ``bad``, or ``none`` if it has not been run.
        verdict: Result in a few words.
        why: Reason of a failure, in a line.
        film: True if there is a film.
        stuck_frame: Frame of the film that shows the failure; None if it does not fail.
        stuck: Numbers of the modules involved.
        steps: Steps of its simulations, in words; empty if it has not been run.
        strip, straight: True if there are these pictures.
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
    steps: str
    strip: bool
    straight: bool


def told(runs: Mapping[str, Run], every: tuple[Experiment, ...]) -> dict[str, Any]:
    """Return the content of page and document, as plain JSON values.

    Args:
        runs: Stored runs by the id of the experiment.
        every: All experiments.
    """
    requests = {experiment.id: experiment.asked for experiment in every}
    runs = {name: run for name, run in runs.items() if run.asked == requests.get(name)}
    return {
        "format": FORMAT,
        "machine": _machine(runs),
        "lead": _lead(runs),
        "summary": _summary(every, runs),
        "overview": [_overview(statement, every, runs) for statement in STATEMENTS],
        "head": [{"name": name, "unit": UNITS.get(name, "")} for name in COLUMNS],
        "sections": [_section(statement, every, runs) for statement in STATEMENTS],
        "ode": page_section(),
        "settings": _settings(),
        "differences": [*_differences(every, runs), *GENERAL_DIFFERENCES],
    }


def _section(
    statement: Statement, every: tuple[Experiment, ...], runs: Mapping[str, Run]
) -> dict[str, Any]:
    of_statement = [experiment for experiment in every if experiment.statement == statement.id]
    pairs = [list(pair) for pair in statement.pairs if all(name in runs for name in pair)]
    by_id = {experiment.id: experiment for experiment in every}
    rows = [
        row
        if (experiment := by_id[name]) in of_statement
        else [f"{row[0]}, {experiment.request.preset}", *row[1:]]
        for name in dict.fromkeys(
            [*chain.from_iterable(pairs), *(experiment.id for experiment in of_statement)]
        )
        for row in [_row(by_id[name], runs.get(name))]
    ]
    published = sorted(
        {experiment.published_steps for experiment in of_statement if experiment.published_steps}
    )
    for steps in published:
        row = ["Published", "folds", f"about {whole(steps)}", seconds(steps * PUBLISHED_STEP_S)]
        rows.insert(0, row + [NONE] * (len(COLUMNS) - len(row)))
    return {
        "id": statement.id,
        "heading": statement.heading,
        "where": statement.where,
        "quote": statement.quote,
        "words": statement.words,
        "found": _by_size(of_statement, runs) if statement.by_size else "",
        "pairs": pairs,
        "cards": [
            asdict(card_of(experiment, runs.get(experiment.id))) for experiment in of_statement
        ],
        "rows": rows,
    }


def card_of(experiment: Experiment, run: Run | None) -> Card:
    """Return the card of an experiment."""
    film = run is not None and run.frames > 0
    return Card(
        id=experiment.id,
        title=experiment.title,
        modules=0 if run is None else run.modules,
        tone="none" if run is None else "good" if run.verified else "bad",
        verdict=verdict(run),
        why="" if run is None or run.verified else why(run),
        film=film,
        stuck_frame=None if run is None else run.stuck_frame,
        stuck=() if run is None else run.overlap.modules if run.overlap else run.stuck,
        steps="" if run is None else _steps(run),
        strip=film and experiment.strip,
        straight=film and experiment.straight,
    )


def verdict(run: Run | None) -> str:
    """Return the result in one or two words."""
    if run is None:
        return "not run yet"
    if run.verified:
        return run.verdict
    if run.refused:
        return "refused"
    if run.overlap is not None:
        return "tangles"
    if run.playback is None:
        return "does not unfold"
    return "not verified" if run.playback.status == "folded" else "does not arrive"


def why(run: Run) -> str:
    """Return the reason of a failure in one line, with modules counted from 1."""
    if (place := run.overlap) is None:
        return reason_text(run.reason) if run.reason else run.verdict
    a, b = (module + 1 for module in place.modules)
    place_text = "" if place.of == "playback" else " in the plan"
    return (
        f"modules {a} and {b} overlap by {figure(place.depth)} pitch{place_text}, "
        f"{round(100 * place.share)} % into the fold"
    )


def _row(experiment: Experiment, run: Run | None) -> list[str]:
    if run is None:
        return [experiment.title, verdict(None), *[NONE] * (len(COLUMNS) - 2)]
    clearance = run.clearance_playback if run.clearance_playback is not None else None
    proved = f" ({figure(run.bound)})" if run.bound is not None and run.verified else ""
    return [
        experiment.title,
        verdict(run),
        _both(run.explosion, run.playback, lambda phase: whole(phase.steps)),
        _both(run.explosion, run.playback, lambda phase: seconds(phase.simulated_s)),
        f"{run.wall_s:.1f} ({run.processor_s:.1f})",
        NONE if run.rms is None else _small(run.rms),
        NONE if clearance is None else figure(clearance) + proved,
        NONE if run.lag_rad is None else figure(run.lag_rad),
        f"{run.folder_mb:.1f}",
    ]


def _both(explosion: Phase | None, playback: Phase | None, formatted: Any) -> str:
    return " + ".join(formatted(phase) for phase in (explosion, playback) if phase) or NONE


def _lead(runs: Mapping[str, Run]) -> str:
    """Return the paper's main result, and the result here."""
    published = (
        f"The paper folds a chain of 160 cubes into a wrench in about {whole(160_000)} steps."
    )
    run = runs.get("wrench-160")
    if run is None:
        return f"{published} Here it has not been run yet."
    if not (run.verified and run.explosion and run.playback and run.rms is not None):
        return f"{published} Here the same chain fails: {_failed(run)}."
    steps = run.explosion.steps + run.playback.steps
    apart = (
        f" Modules 0.95 pitch wide are proved to stay at least {figure(run.bound)} pitch apart."
        if run.bound
        else ""
    )
    return (
        f"{published} Here the same chain takes {whole(steps)} steps: "
        f"{whole(run.explosion.steps)} for the explosion, {whole(run.playback.steps)} for the "
        "fold. At the end, the modules are "
        f"{'less than ' if run.rms < MIN_SHOWN_ERROR_PITCH else ''}"
        f"{figure(max(run.rms, MIN_SHOWN_ERROR_PITCH))} pitch from their targets "
        "(root mean square); a pitch is the distance between the centres of two linked modules."
        f"{apart}"
    )


def _summary(every: tuple[Experiment, ...], runs: Mapping[str, Run]) -> list[str]:
    """Return sentences that summarise the runs."""
    sentences: list[str] = []
    for published, words in (
        ("verified", "runs that succeed in the paper also succeed here."),
        ("tangled", "runs that fail in the paper also fail here."),
    ):
        of = [
            experiment
            for experiment in every
            if experiment.published == published and experiment.id in runs
        ]
        agreeing = sum(
            runs[experiment.id].verified == (published == "verified") for experiment in of
        )
        if of:
            count = f"All {agreeing}" if agreeing == len(of) else f"{agreeing} of the {len(of)}"
            sentences.append(f"{count} {words}")
    for statement in STATEMENTS:
        of_statement = [experiment for experiment in every if experiment.statement == statement.id]
        if statement.by_size and (sentence := _by_size(of_statement, runs)):
            sentences.append(f"{statement.by_size}, {_small_first(sentence)}")
    missing = len(every) - len(runs)
    if missing:
        sentences.append(f"{missing} of {len(every)} experiments have not been run yet.")
    return sentences


def _overview(
    statement: Statement, every: tuple[Experiment, ...], runs: Mapping[str, Run]
) -> dict[str, str]:
    """Return a statement in one line, with the number of its folds by result."""
    of_statement = [experiment for experiment in every if experiment.statement == statement.id]
    done = [runs[experiment.id] for experiment in of_statement if experiment.id in runs]
    good = sum(run.verified for run in done)
    counts = {
        "verified": good,
        "failed": len(done) - good,
        "not run yet": len(of_statement) - len(done),
    }
    return {
        "id": statement.id,
        "heading": statement.heading,
        "published": statement.published,
        "here": ", ".join(f"{count} {words}" for words, count in counts.items() if count),
    }


def _by_size(experiments: list[Experiment], runs: Mapping[str, Run]) -> str:
    """Return a sentence with the numbers of modules at which folds work or fail."""
    done = [runs[experiment.id] for experiment in experiments if experiment.id in runs]
    good = sorted({run.modules for run in done if run.verified})
    bad = sorted({run.modules for run in done if not run.verified})
    if not bad or not good:
        sizes = _listed([str(n) for n in good or bad])
        return f"Folds {'work' if good else 'fail'} with {sizes} modules." if sizes else ""
    if good[-1] < bad[0]:
        return f"Folds work with up to {good[-1]} modules, and fail with {bad[0]} or more."
    works, fails = (_listed([str(n) for n in sizes]) for sizes in (good, bad))
    return f"Folds work with {works} modules, and fail with {fails}."


def _listed(words: list[str]) -> str:
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))


def _differences(every: tuple[Experiment, ...], runs: Mapping[str, Run]) -> list[str]:
    """Return sentences about experiments that differ from the paper, or failed."""
    sentences: list[str] = []
    for statement in STATEMENTS:
        of_statement = [
            experiment
            for experiment in every
            if experiment.statement == statement.id and experiment.id in runs
        ]
        for words, matching in (
            (
                "Verified here, tangled in the paper",
                _came_out(of_statement, runs, "tangled", verified=True),
            ),
            (
                "Fails here, folds in the paper",
                _came_out(of_statement, runs, "verified", verified=False),
            ),
            (
                "Fails here; the paper states no result for this test",
                _came_out(of_statement, runs, None, verified=False),
            ),
        ):
            if matching:
                titles = "; ".join(_small_first(experiment.title) for experiment in matching)
                sentences.append(f"{words} ({_small_first(statement.heading)}): {titles}.")
    return sentences


def _came_out(
    experiments: list[Experiment], runs: Mapping[str, Run], published: str | None, *, verified: bool
) -> list[Experiment]:
    return [o for o in experiments if o.published == published and runs[o.id].verified == verified]


def _small_first(words: str) -> str:
    return words[:1].lower() + words[1:]


def _failed(run: Run) -> str:
    return f"{verdict(run)}, {why(run)}"


def _steps(run: Run) -> str:
    """Return the steps and the simulated time of all simulations."""
    phases = [phase for phase in (run.explosion, run.playback) if phase]
    simulated = sum(phase.simulated_s for phase in phases)
    steps = whole(sum(phase.steps for phase in phases))
    return f"{steps} steps, {seconds(simulated)} s simulated" if phases else ""


def _small(value: float) -> str:
    return f"< {MIN_SHOWN_ERROR_PITCH:g}" if value < MIN_SHOWN_ERROR_PITCH else figure(value)


def _machine(runs: Mapping[str, Run]) -> str:
    """Return sentences about the machines that ran the experiments."""
    if not runs:
        return ""
    cores = sorted({run.cores for run in runs.values()})
    names = sorted({run.processor for run in runs.values()})
    reference = [run.reference_s for run in runs.values()]
    busy = (
        " The machine was also doing other work, so the processor times in brackets are more "
        "reliable."
    )
    return (
        f"Times were measured on {' and '.join(str(n) for n in cores)} processor cores "
        f"({' and '.join(names)}), where 1000 steps of MuJoCo on a chain of 160 cubes took "
        f"{min(reference):.2f} to {max(reference):.2f} s just before each run."
        f"{busy if max(reference) > BUSY_TIME_RATIO * min(reference) else ''}"
    )


def _settings() -> list[dict[str, str]]:
    parameters = preset("paper")
    return [
        {
            "label": setting.label,
            "name": setting.name,
            "value": _value(value_of(setting, parameters), setting.unit),
            "source": SOURCES[setting.source],
            "meaning": setting.help,
        }
        for setting in SETTINGS
    ]


def _value(value: float | None, unit: str) -> str:
    if value is None:
        return "none"
    if unit == "°":
        return f"{figure(value)}°"
    return f"{figure(value)} {'step' if (value, unit) == (1, 'steps') else unit}".strip()
