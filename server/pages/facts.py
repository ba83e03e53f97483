"""Facts: the data and texts about a fold that its page shows."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final, Literal, NotRequired, TypedDict, cast, get_args

import numpy as np

from foldback.planner.certificate.figures import (
    CertificateFigures,
    FoldSummary,
)
from foldback.planner.errors import UNREADABLE
from foldback.planner.exports.export import Export
from foldback.planner.exports.formats import exports_of
from foldback.planner.motion.record import TableRecord
from foldback.planner.parameters.parameters import BASELINE, FLOATING, TURN_STRATEGIES
from foldback.planner.parameters.settings_text import TABLE_SETTINGS
from foldback.planner.pathfinding.path_options import MAX_TABLE_MODULES
from foldback.planner.pipeline.fold_layout import result_path
from foldback.planner.pipeline.preference import COMPUTING, Preference, preference_named
from foldback.planner.pipeline.request import MAX_SEED, FoldRequest
from foldback.planner.smoothing import MAX_SMOOTHED_ANGLES
from foldback.planner.storage.file_names import ATTEMPTS, CERTIFICATE, CHAIN, PLAN, RECORD, TIMELINE
from foldback.planner.storage.files import json_of
from foldback.planner.twist_chains.folded_chains import is_coded
from foldback.planner.verification.integrity import damaged_among
from foldback.server.errors import MOTION_FILES, damage_words
from foldback.server.pages.table_check import ruled_out_on_table
from foldback.server.processes.movie_task import movie_formats
from foldback.server.schemas import export_href
from foldback.server.store.estimates import Expected, expected_of_cost, plain_fold
from foldback.server.store.fold_files import frames_promised
from foldback.server.store.fold_source import LocatedFold
from foldback.server.store.schema import request_of
from foldback.server.viewing.fold_notes import full_size_of
from foldback.words import certificate as certificate_words
from foldback.words.certificate import TableWords
from foldback.words.failures import AttemptWords, Failure, attempts, failure, tightest_frame
from foldback.words.fold import RUNNING_STATUSES, ShownFold, has_motion, step_count
from foldback.words.joint_errors import (
    HURDLES,
    QUESTION,
    BuildWords,
    again_label,
    build_words,
)
from foldback.words.plan_choice import Choice, choice_of
from foldback.words.properties import Properties, properties
from foldback.words.purposes import FileName, Purpose, purposes_of
from foldback.words.reachability import FullSize
from foldback.words.smoothing import (
    BeforeAfter,
    smoothing_gain,
    smoothing_note,
    smoothing_question,
    smoothing_rows,
)
from foldback.words.suggestions import (
    AGAIN_LABELS,
    EXPLOSION,
    FLOATING_FOLD,
    OTHER_PRESETS,
    PUBLISHED_CHANGED,
    RECORDED,
    Button,
    about,
    another_seed,
    on_a_table,
    preferring,
    published,
)
from foldback.words.verdict import (
    COVER_LOADING,
    COVER_WAITING,
    NO_DOWNLOADS,
    NO_DOWNLOADS_YET,
    VIEW_FILES,
    Problem,
    Verdict,
    damage_of,
    origin_of,
    preset_of,
    problem_of,
    verdict_of,
)

SHOWN_FILES: Final = (TIMELINE, CHAIN, CERTIFICATE, ATTEMPTS)
"""Files that the page of a fold needs; the page reports those that are damaged."""

SCRIPT_FACTS: Final = (
    *("id", "name", "running", "verdict", "failure", "choice", "again", "frames"),
    *("tightest", "steps", "compare", "refold", "embed", "editable", "options", "full_size"),
    "build",
)
"""Facts that the scripts of pages use."""

USUAL_TRAJECTORY: Final = "trajectory?max_speed=1&max_acceleration=2&format=csv"
"""Trajectory with the limits that the page proposes, rad/s and rad/s²."""

MAX_SAMPLED_MODULES: Final = 400
"""Largest number of modules of a chain whose page offers a fold that sweeps sampled robots: 160
take half a minute of the processor, and the time grows with the square of the number."""

Form = dict[str, str | int | float]
"""Fields of a form that requests a fold."""


class Suggestion(TypedDict):
    """Another fold to request or to view: the button's label, and its form or id."""

    text: str
    hint: NotRequired[str]
    form: NotRequired[Form]
    id: NotRequired[str]
    settable: NotRequired[str]


class Smoothing(TypedDict):
    """Changes by smoothing, and a link to both plans side by side."""

    rows: list[BeforeAfter]
    gain: str | None
    note: str
    compare: str | None


class Build(TypedDict):
    """Answer to whether a robot could follow a plan, and the fold that suits other hinges."""

    question: str
    words: BuildWords
    again: Suggestion | None
    hurdles: tuple[tuple[str, str, str], ...]


class Download(TypedDict):
    """A file to download."""

    label: str
    hint: str
    href: str


class FoldFacts(TypedDict):
    """Everything that a fold's page shows besides the timeline; ``Facts`` in ``web/types.d.ts``."""

    id: str
    name: str
    status: str
    running: bool
    preset: str
    verdict: Verdict
    cover: str
    problem: Problem | None
    failure: Failure | None
    attempts: list[AttemptWords]
    choice: Choice | None
    table: TableWords | None
    again: Suggestion | None
    frames: int
    tightest: float | None
    steps: int
    refoldable: bool
    refold: Form
    smooth_question: str | None
    smoothing: Smoothing | None
    comparable: bool
    compare: list[Suggestion]
    options: Literal["all", "owner"] | None
    alternative_to: str | None
    embed: str | None
    kept: str | None
    made: str | None
    editable: bool
    movies: list[str]
    robot: bool
    files: list[Download]
    properties: list[Properties]
    full_size: FullSize | None
    purposes: list[Purpose]
    downloads: list[Download]
    downloads_hint: str
    checkable: bool
    build: Build | None


def script_facts(facts: FoldFacts) -> dict[str, object]:
    """Return the facts that a page's scripts use; its HTML states all others."""
    return {name: facts[name] for name in SCRIPT_FACTS}


def fold_facts(
    located: LocatedFold,
    *,
    api: bool = True,
    embed: bool = False,
    lifetime_text: str | None = None,
    expected: Expected = expected_of_cost,
) -> FoldFacts:
    """Return everything that the page shows besides the timeline, as JSON values.

    Args:
        located: The fold.
        api: True if the service's API is available for downloads and events.
        embed: True if other sites may embed folds in a frame.
        lifetime_text: Visibility and expiry of the fold in words.
        expected: Returns the estimated time of another fold that is offered, s.
    """
    row, directory = located.row, located.directory
    api = api and located.alternative_to is None
    summary = row.summary
    running = row.status in RUNNING_STATUSES
    damaged = [] if running else damaged_among(directory, SHOWN_FILES)
    done = row.status in ("verified", "failed")
    certificate = CertificateFigures() if running else _certificate(directory, summary, damaged)
    choice = choice_of(directory, preference_named(row.prefer), playable=api) if done else None
    has_plan = api and done and (directory / PLAN).is_file()
    facts: FoldFacts = {
        "id": row.id,
        "name": row.title,
        "status": row.status,
        "running": running and api,
        "preset": preset_of(row),
        "verdict": verdict_of(row, summary, certificate, choice),
        "cover": COVER_WAITING if running else COVER_LOADING,
        "problem": problem_of(row, summary),
        "failure": failure(row, summary),
        "attempts": attempts(directory) if not running else [],
        "choice": choice,
        "table": certificate_words.on_table(certificate, _on_table(row, directory)),
        "again": _again(row) if api else None,
        "frames": frames_promised(directory),
        "tightest": None if running else tightest_frame(summary),
        "steps": 0 if running else step_count(summary),
        "refoldable": api and row.status == "verified" and row.world == FLOATING,
        "refold": _published(row),
        "smooth_question": _smooth_question(row, summary, expected) if api else None,
        "smoothing": _smoothing(located if api else None, summary),
        "comparable": api and not running,
        "options": _options(row) if api and not running else None,
        "alternative_to": located.alternative_to,
        "compare": _compare(located, expected) if api and not running else [],
        "embed": f"/embed/{row.id}" if embed else None,
        "kept": lifetime_text,
        "made": origin_of(summary),
        "editable": (editable := api and not running and frames_promised(directory) > 0),
        "movies": list(movie_formats()) if editable else [],
        "robot": api and row.status == "verified",
        "files": [] if running else _files(located),
        "full_size": full_size_of(located),
        "properties": properties(row, summary, certificate, directory),
        "purposes": _purposes(located) if has_plan else [],
        "downloads": _downloads(row, summary) if has_plan else [],
        "downloads_hint": NO_DOWNLOADS_YET if running else NO_DOWNLOADS,
        "checkable": bool(has_plan) and row.status == "verified",
        "build": _build(row, certificate, api=api) if row.status == "verified" else None,
    }
    return _with_damage(facts, damaged) if damaged else facts


def _certificate(directory: Path, summary: FoldSummary, damaged: list[str]) -> CertificateFigures:
    """Return the certificate of a fold from its summary, or from its directory."""
    if certificate := summary.get("certificate"):
        return certificate
    stored = {} if CERTIFICATE in damaged else json_of(result_path(directory, CERTIFICATE))
    return cast(CertificateFigures, stored)


def _downloads(row: ShownFold, summary: FoldSummary) -> list[Download]:
    """Return the formats in which the plan of a fold can be downloaded."""
    return [
        {"label": export.label, "hint": export.hint, "href": export_href(row.id, export)}
        for export in _exports(row, summary)
    ]


def _exports(row: ShownFold, summary: FoldSummary) -> tuple[Export, ...]:
    return exports_of(
        moving=has_motion(summary), resting=step_count(summary) > 0, coded=is_coded(row.module)
    )


def _purposes(located: LocatedFold) -> list[Purpose]:
    """Return what people may want to do with a fold, with the file for each."""
    row = located.row
    files: dict[FileName, str] = {
        name: export_href(row.id, export)
        for export in _exports(row, row.summary)
        for name in get_args(FileName)
        if name == export.name
    }
    if _files(located):
        files["html"] = f"/folds/{row.id}/{VIEW_FILES[0][0]}"
    if row.status == "verified":
        files["trajectory"] = f"/api/folds/{row.id}/{USUAL_TRAJECTORY}"
    else:
        files.pop("npz", None)  # nothing is proved of it
    return purposes_of(row, files)


def _files(located: LocatedFold) -> list[Download]:
    """Return the files that show a fold's motion; none for an alternative to its plan."""
    if not frames_promised(located.directory) or located.alternative_to is not None:
        return []
    return [
        {"href": f"/folds/{located.row.id}/{name}", "label": label, "hint": hint}
        for name, label, hint in VIEW_FILES
    ]


def _with_damage(facts: FoldFacts, damaged: list[str]) -> FoldFacts:
    """Return facts that report the damaged data, and offer nothing that is derived from it."""
    heading = damage_words(damaged)
    changed: FoldFacts = {
        **facts,
        "verdict": {"tone": "bad", "text": heading},
        "problem": damage_of(heading, damaged),
    }
    if any(name in MOTION_FILES for name in damaged):
        changed["frames"], changed["tightest"], changed["steps"] = 0, None, 0
        changed["editable"] = changed["robot"] = False
        changed["refoldable"] = changed["comparable"] = False
        changed["smooth_question"] = None
        changed["files"], changed["downloads"], changed["compare"] = [], [], []
        changed["purposes"] = []
        changed["movies"] = []
        changed["checkable"], changed["build"] = False, None
    return changed


def _published(row: ShownFold) -> Form:
    """Return the fields that request a fold's published method; none for other presets."""
    request = FoldRequest(preset=row.preset, settings=row.settings)
    return request.changed() if row.preset == "paper" else {}


def _form(row: ShownFold, request: FoldRequest, *stated: str) -> Form:
    """Return the fields that request a fold of the same input; ``stated`` ones even as defaults."""
    changed = {name: value for name, value in request.changed().items() if name != "module"}
    values = {"seed": request.seed, **changed, **{name: getattr(request, name) for name in stated}}
    return {"fold": row.id, **values}


def _again(row: ShownFold) -> Suggestion | None:
    """Return the label and the form of the button that tries a failed fold again."""
    request, plain = request_of(row), FoldRequest()
    if row.status == "cancelled":
        return {"text": AGAIN_LABELS["same"], "form": _form(row, request, "preset")}
    if row.status != "failed" or row.stage == "read":  # such an input fails again
        return None
    if row.preset != plain.preset:
        change, other_request = "preset", replace(request, preset="default", settings="")
    elif row.module_size is not None and row.module_size > plain.parameters().module_size:
        change, other_request = "module_size", replace(request, module_size=None)
    elif request.strategy in TURN_STRATEGIES:  # seeds hardly change turns
        change, other_request = "strategy", replace(request, strategy=plain.strategy)
    else:
        change, other_request = "seed", replace(request, seed=_next_seed(row))
    return {"text": AGAIN_LABELS[change], "form": _form(row, other_request, "preset")}


def _build(row: ShownFold, certificate: CertificateFigures, *, api: bool) -> Build | None:
    """Return whether a robot could follow a plan; None if unknown."""
    words = build_words(certificate)
    if words is None:
        return None
    errors, request, again = certificate.get("joint_errors"), request_of(row), None
    if not api or row.refold or row.smooths or errors is None:
        pass
    elif (size := errors["module_size"]) is not None and size < certificate.get("module_size", 0.0):
        error = f"{np.degrees(errors['error_rad']):.4g}deg"
        smaller = replace(
            request,
            joint_error=error if row.modules <= MAX_SAMPLED_MODULES else None,
            module_size=size,
        )
        again = _suggestion(Button(again_label(size)), _form(row, smaller, "preset"))
    return {"question": QUESTION, "words": words, "again": again, "hurdles": HURDLES}


def _next_seed(row: ShownFold) -> int:
    """Return the seed after that of a fold."""
    return (row.seed + 1) % (MAX_SEED + 1)


def _options(row: ShownFold) -> Literal["all", "owner"] | None:
    """Return who may fold the same input with other options; None for plans made of others."""
    if row.refold or row.smooths:
        return None
    return "all" if row.shape else "owner"


def _compare(located: LocatedFold, expected: Expected) -> list[Suggestion]:
    """Return the labels and forms of the buttons that fold the same input by another method."""
    row = located.row
    plain = FoldRequest(seed=row.seed, module_size=row.module_size)
    seed = _next_seed(row)
    comparable = replace(request_of(row), strategy=plain.strategy, prefer=plain.prefer, seed=seed)
    another = _suggestion(another_seed(seed), _form(row, comparable, "preset"))
    if row.smooths:
        if (before := located.recorded) is None:
            return [another]
        return [{"text": RECORDED.text, "hint": RECORDED.hint, "id": before}, another]
    if row.world != FLOATING:
        floating = replace(plain, settings=_floating_settings(row.settings))
        return [_suggestion(FLOATING_FOLD, _form(row, floating, "settings")), another]
    return [*_other_methods(located, plain, expected), another]


def _other_methods(
    located: LocatedFold, plain: FoldRequest, expected: Expected
) -> list[Suggestion]:
    """Return the suggestions for a fold without a table: table, preference and presets.

    For chains so long that they usually stall on a table, the table comes after the other presets.
    ``settable`` states whether settings of the published method may or must be sent with it.
    """
    row = located.row
    cube = FoldRequest(module=row.module)

    def time(request: FoldRequest) -> str:
        return about(expected(plain_fold(row.modules, request)))

    suggestions: list[Suggestion] = []
    if row.preset == plain.preset:
        unlike: Preference = "time" if row.prefer == COMPUTING else COMPUTING
        button = preferring(unlike, time(replace(cube, prefer=unlike)))
        suggestions.append(_suggestion(button, _form(row, replace(plain, prefer=unlike), "prefer")))
        if step_count(row.summary):  # it took turns
            explosion = replace(plain, strategy="simultaneous")
            suggestions.append(_suggestion(EXPLOSION, _form(row, explosion)))
    for preset, button in OTHER_PRESETS.items():
        if (preset, "") != (row.preset, row.settings):
            suggestions.append(
                _suggestion(button, _form(row, replace(plain, preset=preset), "preset"))
            )
    if _may_rest(row) and not ruled_out_on_table(result_path(located.directory, CHAIN)):
        button = on_a_table(time(FoldRequest(world="table")), row.modules)
        table = _suggestion(button, _form(row, replace(plain, world="table")))
        suggestions.insert(0 if row.modules <= MAX_TABLE_MODULES else len(suggestions), table)
    by_paper = (row.preset, row.settings) == ("paper", "")
    button = PUBLISHED_CHANGED if by_paper else published(time(replace(cube, preset="paper")))
    last = _suggestion(button, _form(row, replace(plain, preset="paper")))
    return [*suggestions, {**last, "settable": "must" if by_paper else "may"}]


def _suggestion(button: Button, form: Form) -> Suggestion:
    return {"text": button.text, "hint": button.hint, "form": form}


def _may_rest(row: ShownFold) -> bool:
    """Return True if the same shape may be folded on a table."""
    plain = FoldRequest()
    own_presets, usual = (row.preset, row.module), (plain.preset, plain.module)
    return own_presets == usual and not row.refold and not row.settings


def _floating_settings(settings: str) -> str:
    """Return the settings without those of a table."""
    names = {setting.name for setting in TABLE_SETTINGS}
    return ",".join(s for s in settings.split(",") if s.partition("=")[0] not in names)


def _on_table(row: ShownFold, directory: Path) -> TableRecord | None:
    """Return the explosion's figures of a fold on a table; None if unknown."""
    if row.world == FLOATING:
        return None
    try:
        with np.load(result_path(directory, RECORD), allow_pickle=False) as arrays:
            return TableRecord.of(arrays)
    except UNREADABLE:
        return None


def _smooth_question(row: ShownFold, summary: FoldSummary, expected: Expected) -> str | None:
    """Return the question before a plan is smoothed; None if it should not or cannot be.

    Turns of one hinge at a time are the calmest motion, which smoothing would disturb.
    """
    explosion = summary.get("explosion") or {}
    if (
        row.status != "verified"
        or row.world != FLOATING
        or summary.get("refold")
        or summary.get("smoothing")
        or explosion.get("strategy") == BASELINE
    ):
        return None
    frames = explosion.get("frames") or 0
    if frames * int(summary.get("hinges") or 0) > MAX_SMOOTHED_ANGLES:
        return None
    smoothed = plain_fold(row.modules, FoldRequest(module=row.module))
    smoothed.smooths = row.id
    return smoothing_question(expected(smoothed), by_turns=step_count(summary) > 0)


def _smoothing(located: LocatedFold | None, summary: FoldSummary) -> Smoothing | None:
    """Return the changes by smoothing in words; None for a recorded plan.

    Without ``located``, there is no link to both plans.
    """
    if not (smoothing := summary.get("smoothing")):
        return None
    of = located and located.recorded
    return {
        "rows": smoothing_rows(smoothing),
        "gain": smoothing_gain(smoothing),
        "note": smoothing_note(smoothing),
        "compare": f"/compare?a={of}&b={located.row.id}" if located and of else None,
    }
