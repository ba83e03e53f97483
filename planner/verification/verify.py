"""Verification: a fold's directory checked anew, from its files alone.

All statements about the plan are either computed again or compared with equal ones in other files,
and the rest with the digests in the manifest. Differences are reported by file and field.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from foldback import foldback_check
from foldback.planner.certificate.certificate import Certificate, certify
from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.chain.display_names import escaped
from foldback.planner.clearance.margins import Margin, limit_at, unproved_margins
from foldback.planner.errors import UNREADABLE, InputError, TimelineError, named
from foldback.planner.exports import mjcf
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.pipeline import manifest
from foldback.planner.plan.model_differences import model_differences
from foldback.planner.plan.plan import Plan, read_values
from foldback.planner.plan.value_differences import (
    RECOMPUTED_RTOL,
    Differences,
    figure_differences,
    value_differences,
)
from foldback.planner.playback.playback import Playback
from foldback.planner.progress import Report, silent
from foldback.planner.storage.file_names import (
    FORCES,
    MODEL,
    PLAN,
    PLAN_TEXT,
    RECORDED_PLAN,
    TIMELINE,
    VERDICT_FILES,
)
from foldback.planner.storage.output_directory import finish_replacement
from foldback.planner.verification.certificate_figures import ReportedFigures
from foldback.planner.verification.failure_evidence import ReasonCheck
from foldback.planner.verification.origin import attempts_differ, input_differs
from foldback.planner.verification.plan_consistency import contradictions, formats_differ, lacking
from foldback.planner.verification.plan_failure import reason_of
from foldback.planner.verification.plan_parameters import plan_parameters, request_differs
from foldback.planner.verification.playback_kinds import kind_differs
from foldback.planner.verification.repeated import (
    forces_differ,
    plots_differ,
    robots_differ,
    smoothing_differs,
    verdict_differs,
    why_not_repeated,
)
from foldback.planner.verification.replay import Replay, replay, replay_differs, stride_of
from foldback.planner.verification.stage_files import stage_files_differ
from foldback.planner.verification.third_opinion import Opinion, opinion_of, toolkit
from foldback.planner.verification.timelines import (
    chain_differs,
    kept_record,
    opened,
    playback_differs,
    results,
    with_other_robots,
)

MAX_DIFFERENCES: Final = 8
"""Maximum number of differences that a verification lists for each thing that it checks (motion,
model, certificate, …): values or files that are not what a new computation gives. Further ones are
only counted."""
REPORTED_ONLY: Final = (
    "Reported only, that is neither computed again nor compared with another file: versions, wall "
    "times (seconds), request.json filename where the input itself states a name, pushes and "
    "retries in record.npz, the values for single modules and hinges in the figures and "
    "table.npz, and files besides those of the plan (plans, pictures, tours, own values)."
)
"""Note that names the values which no check covers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verification:
    """Result of the verification of a plan's files.

    Attributes:
        certificate: Certificate computed again from the files.
        robots_repeated: True if the simulated robots folded the chain once more, and False if their
            figures are those of the files; None without a simulation.
        reason: Check of the reason of a failed explosion; None for others, and if the check was
            not possible.
        replay: Replay of the exported model with the plan's angles in plain MuJoCo.
        opinion: Result of another program; None if none was asked.
        checked: Checks that found no problem, in plain English.
        problems: Contradictions of the plan, in plain English.
        notes: Checks that were not possible, and the reasons.
    """

    certificate: Certificate
    robots_repeated: bool | None
    reason: ReasonCheck | None
    replay: Replay | None
    opinion: Opinion | None
    checked: tuple[str, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def verified(self) -> bool:
        """True if the certificate verifies the plan and there are no contradictions."""
        return self.certificate.verified and not self.problems

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values; a certificate that fails is the first problem."""
        refusal = () if self.certificate.verified else (escaped(self.certificate.verdict),)
        return {
            "status": "verified" if self.verified else "failed",
            "problems": [*refusal, *self.problems],
            "notes": list(self.notes),
            "checked": list(self.checked),
            "robots_repeated": self.robots_repeated,
            "reason": None if self.reason is None else self.reason.as_dict(),
            "replay": None if self.replay is None else asdict(self.replay),
            "opinion": None if self.opinion is None else asdict(self.opinion),
            "certificate": self.certificate.as_dict(),
        }


def verify(
    directory: FilePath,
    *,
    module_size: float | None = None,
    third_opinion: bool = False,
    progress: Report = silent,
) -> Verification:
    """Check the plan in a directory by exact kinematics and by a replay in plain MuJoCo.

    Args:
        directory: Directory with ``plan.npz``, ``model.xml``, ``timeline``, and other files of the
            fold's stages; ``plan.json`` is compared if it is there.
        module_size: Another size than the plan's own.
        third_opinion: Let ipctk look at the motion as well.
        progress: Receives the current check.

    Raises:
        InputError: A file is missing or cannot be read.
        TimelineError: The timeline is missing or damaged.
    """
    if third_opinion:
        toolkit()
    finish_replacement(directory)
    try:
        try:
            # What damaged numbers come out as, infinite or none, is told as any other difference.
            with np.errstate(all="ignore"):
                return _verified(directory, module_size, progress, third_opinion=third_opinion)
        except UNREADABLE as error:
            raise InputError(
                "not-a-plan", f"plan.npz: its figures cannot be computed again ({error})."
            ) from error
    except (InputError, TimelineError) as error:
        changed = manifest.changed_fields(directory)
        if not changed:
            raise
        further = (
            ""
            if len(changed) <= MAX_DIFFERENCES
            else f", and {len(changed) - MAX_DIFFERENCES} more"
        )
        message = (
            f"{error} These fields were changed: {'; '.join(changed[:MAX_DIFFERENCES])}{further}."
        )
        if isinstance(error, InputError):
            raise InputError(error.code, message) from error
        raise TimelineError(message) from error


def _verified(
    directory: FilePath, module_size: float | None, progress: Report, *, third_opinion: bool
) -> Verification:
    findings = _Findings()
    npz = read_values(directory / PLAN)
    plan = Plan.of_values(npz, PLAN)
    findings.look("the values in plan.npz agree with each other", contradictions(plan, npz))
    if (directory / PLAN_TEXT).exists():
        text = read_values(directory / PLAN_TEXT)
        findings.look("plan.json and plan.npz hold the same data", formats_differ(plan, npz, text))
    timeline, frames = opened(directory / TIMELINE)
    findings.look("the timeline belongs to this chain", chain_differs(timeline, plan))
    record, playback = _results(directory, plan, frames, findings.notes)
    findings.look("plan.npz is complete", lacking(plan, npz, record, playback))
    if playback is not None:
        findings.look("the timeline shows the plan's playback", playback_differs(plan, playback))
        findings.look(
            "the plan states correctly whether the playback was simulated",
            kind_differs(plan, playback),
        )
    findings.look(
        "the files of the stages match the plan",
        stage_files_differ(directory, plan, npz, record, findings.notes),
    )
    parameters = plan_parameters(plan, module_size)
    findings.look(
        "the plan's parameters are those of the request",
        request_differs(directory, plan, findings.notes),
    )
    findings.look(
        "the input was read again and gives the plan's chain",
        input_differs(directory, plan, findings.notes),
    )
    findings.look(
        "the attempts are those that follow from the request",
        attempts_differ(directory, plan, findings.notes),
    )
    repeated = _check_robots(directory, plan, playback, findings)
    forces: list[TableForces] = []
    certificate = certify(
        plan.chain,
        record,
        playback,
        parameters,
        start=plan.start,
        progress=progress,
        with_margins=module_size is None,
        forces=forces.append,
    )
    if module_size is None:
        stated = ReportedFigures(plan, record, playback)
        _check_figures(directory, stated, certificate, findings, repeated=repeated)
        if forces and (directory / FORCES).exists():
            findings.look(
                "the largest torques in table.npz were computed again and match",
                forces_differ(directory, forces[0]),
            )
        if plan.smoothing is not None and (directory / RECORDED_PLAN).exists():
            findings.look(
                "the figures before and after smoothing were computed again and match",
                smoothing_differs(directory, plan),
            )
        findings.look(
            "moments.json and the curves of the plots were computed again and match",
            plots_differ(directory, plan, findings.notes),
        )
    if any((directory / name).exists() for name in VERDICT_FILES):
        findings.look(
            "verdict.json and exhaustion.json were computed again and match",
            verdict_differs(directory),
        )
    opinion = _opinion(directory, npz, certificate, findings) if third_opinion else None
    reason = _reason(directory, plan, findings)
    replayed = None
    if len(plan.chain) <= mjcf.MAX_MODEL_MODULES or (directory / MODEL).exists():
        model = _text(directory / MODEL)
        findings.look("model.xml is the plan's model", _model(model, plan))
        replayed = _replayed(plan, model, findings)
    else:
        findings.notes.append(
            f"Folds of more than {mjcf.MAX_MODEL_MODULES} modules have no model.xml, so the plan "
            "was not replayed in MuJoCo."
        )
    _check_manifest(directory, findings)
    findings.notes.append(REPORTED_ONLY)
    return Verification(
        certificate=certificate,
        robots_repeated=repeated,
        reason=reason,
        replay=replayed,
        opinion=opinion,
        checked=tuple(findings.checked),
        problems=tuple(map(escaped, findings.problems)),
        notes=tuple(map(escaped, findings.notes)),
    )


def _check_robots(
    directory: FilePath, plan: Plan, playback: Playback | None, findings: _Findings
) -> bool | None:
    """Repeat the simulation of a playback; return False if that is not possible, None without."""
    if playback is None or not playback.simulated:
        return None
    reason = why_not_repeated(directory, plan, playback)
    if reason is not None:
        findings.notes.append(
            f"The simulation of the robots was not repeated, because {reason}. Their figures "
            "(joint errors, torques) are reported only."
        )
        return False
    findings.look(
        "the simulated robots folded the chain once more, and did the same",
        robots_differ(directory, plan, playback),
    )
    return True


def _check_figures(
    directory: FilePath,
    stated: ReportedFigures,
    certificate: Certificate,
    findings: _Findings,
    *,
    repeated: bool | None,
) -> None:
    """Compare the reported figures with a certificate computed again; prove its bounds again."""
    alone = " (not computed again: simulated torques, and the largest error between frames)"
    findings.look(
        "the certificate's figures were computed again and match"
        f"{alone if repeated is False else ''}",
        stated.differences(certificate, findings.notes),
    )
    if certificate.verified and stated.plan.certificate.clearance_bound:
        findings.look(
            "an independent checker proves the clearance from plan.npz alone",
            _unproved(directory, stated.plan.chain.module.name),
        )
    if not certificate.verified:
        return
    if stated.plan.certificate.margins is not None:
        findings.look(
            "the margins were proved and computed again", _margins_differ(stated.plan, certificate)
        )
    elif certificate.margins is not None:
        findings.notes.append("The plan states no margins, although there are some.")


def _unproved(directory: FilePath, module: str) -> Differences:
    """Yield what the independent checker cannot prove; a straight chain need not fold.

    It knows some modules by name. Others are as the plan's claim describes them, which was compared
    with the module of the chain.
    """
    result: dict[str, Any] = foldback_check.check(directory / PLAN)
    allowed = {foldback_check.NOTHING}
    if module not in foldback_check.MODULES and module not in foldback_check.TWISTS:
        allowed.add(foldback_check.OTHER_MODULE)
    if result["verdict"] == "not proved" or not allowed.issuperset(result["limits"]):
        yield f"plan.npz: the independent checker cannot prove the plan: {result['reason']}"


def _margins_differ(plan: Plan, recomputed: Certificate) -> Differences:
    """Yield the margins that cannot be proved, and those that differ from the ones found again.

    Of several places that are equally close, rounding decides which one is reported.
    """
    stated, size = plan.certificate.margins, plan.certificate.module_size
    assert stated is not None
    for name in unproved_margins(plan.chain, plan.motion, stated, module_size=size):
        value = getattr(stated, name).value
        yield f"plan.npz certificate.margins.{name}: got {value:g}, which cannot be proved"
    if recomputed.margins is None:
        yield "plan.npz certificate.margins: got margins, expected none"
        return
    yield from figure_differences(
        stated.failure_probability,
        recomputed.margins.failure_probability,
        "plan.npz certificate.margins.failure_probability",
    )
    for name in ("module_size", "one_hinge_rad", "independent_rad"):
        own_margin, recomputed_margin = getattr(stated, name), getattr(recomputed.margins, name)
        place_name = f"plan.npz certificate.margins.{name}"
        yield from value_differences(
            own_margin.value, recomputed_margin.value, place_name, rtol=RECOMPUTED_RTOL
        )
        if own_margin.limited_by != recomputed_margin.limited_by and not _limits(
            plan, name, own_margin, recomputed_margin
        ):
            yield from value_differences(
                asdict(own_margin.limited_by),
                asdict(recomputed_margin.limited_by),
                f"{place_name}.limited_by",
            )


def _limits(plan: Plan, name: str, stated: Margin, recomputed: Margin) -> bool:
    """Return True if a margin's modules touch at the same value as those that were found again."""
    chain, motion, size = plan.chain, plan.motion, plan.certificate.module_size
    place = stated.limited_by
    if place.modules is None or not 0.0 <= place.frame <= len(motion) - 1:
        return False
    i, j = place.modules
    if not (i >= 0 and i + chain.module.apart <= j < len(chain)):
        return False
    first_limit, second_limit = (
        limit_at(chain, motion, name, margin.limited_by, module_size=size)
        for margin in (stated, recomputed)
    )
    return abs(first_limit - second_limit) <= RECOMPUTED_RTOL * abs(second_limit)


def _opinion(
    directory: FilePath, npz: dict[str, Any], certificate: Certificate, findings: _Findings
) -> Opinion | None:
    """Return what ipctk says about a plan's motion; None if there is no claim to ask about.

    The claim is that of the certificate that was computed again, or else the file's own.
    """
    proved = certificate.clearance_bound if certificate.verified else None
    claim = proved or npz["certificate"].get("clearance_bound")
    if not claim:
        findings.notes.append("The check with ipctk was skipped: the plan claims no clearance.")
        return None
    try:
        opinion = opinion_of(directory / PLAN, certificate.module_size, claim)
    except InputError as error:
        findings.problems.append(f"failed: ipctk cannot check the motion: {error.detail}")
        return None
    findings.look(opinion.words, opinion.problems)
    return opinion


def _results(
    directory: FilePath, plan: Plan, frames: Motion, notes: list[str]
) -> tuple[Record | None, Playback | None]:
    """Return the record and the playback that a plan and its timeline tell of.

    Raises:
        InputError: ``not-a-plan`` if they cannot be read.
    """
    try:
        record, playback = results(plan, frames)
        if record is None and plan.explosion is not None:
            record = kept_record(directory, plan)
        return record, with_other_robots(directory, playback, notes)
    except (TypeError, AttributeError) as error:
        raise InputError(
            "not-a-plan", f"the results in plan.npz cannot be read ({error}); plan the fold again."
        ) from error


def _reason(directory: FilePath, plan: Plan, findings: _Findings) -> ReasonCheck | None:
    """Check the reason why an explosion stalled; None if it did not, or states none."""
    if plan.explosion is None or plan.explosion["status"] in ("straight", "cancelled"):
        return None
    reason = reason_of(directory, plan, findings.notes)
    if reason is not None:
        findings.look(
            "the reason why unfolding stalled was confirmed",
            (
                f"the reason why unfolding stalled is not confirmed: {difference}"
                for difference in reason.differences
            ),
        )
    return reason


def _replayed(plan: Plan, model: str, findings: _Findings) -> Replay | None:
    """Replay a plan in plain MuJoCo; None if it has no frames, or its model cannot be used."""
    if not len(plan.time_s):
        return None
    stride = stride_of(plan)
    try:
        replayed = replay(plan, model, stride=stride)
    except InputError as error:
        findings.problems.append(f"failed: model.xml: {error.detail}")
        return None
    sampling_note = "" if stride == 1 else f" (checked at one frame in {stride})"
    findings.look(
        f"the replay in MuJoCo has the plan's poses and no overlap{sampling_note}",
        replay_differs(replayed),
    )
    return replayed


def _check_manifest(directory: FilePath, findings: _Findings) -> None:
    changed = manifest.changed_fields(directory)
    if changed is None:
        findings.problems.append(
            f"failed: {manifest.FILE}, the file with the digests of all fields, is missing; copy "
            "it with the fold's other files."
        )
    else:
        findings.look(
            "every field of every file matches its digest in manifest.json",
            (
                field if field.endswith(manifest.MISSING) else f"{field} was changed"
                for field in changed
            ),
        )


class _Findings:
    """Passed checks, problems and notes."""

    def __init__(self) -> None:
        self.checked: list[str] = []
        self.problems: list[str] = []
        self.notes: list[str] = []

    def look(self, at: str, differences: Differences) -> None:
        texts = list(dict.fromkeys(differences))
        if not texts:
            self.checked.append(at)
        self.problems += [f"failed: {text}" for text in texts[:MAX_DIFFERENCES]]
        if (further := len(texts) - MAX_DIFFERENCES) > 0:
            self.problems.append(f'failed: … and {further} more differences in the check "{at}"')


def _model(text: str, plan: Plan) -> Differences:
    """Yield the differences of the model from the plan's."""
    try:
        size = plan_parameters(plan, None).module_size
        expected = mjcf.mjcf(plan.chain, module_size=size, keys=mjcf.keys_of(plan))
        for difference in model_differences(mjcf.named_bodies(text), expected):
            yield f"model.xml: {difference}"
    except InputError as error:
        raise named(error, MODEL) from None


def _text(path: FilePath) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("not-a-model", f"{path.name} cannot be read: {error}") from error
