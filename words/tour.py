"""A draft of a fold's tour, with the figures of its certificate."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, Literal, NamedTuple

from foldback.planner.certificate.figures import CertificateFigures
from foldback.planner.chain.display_names import clean_name
from foldback.planner.plan.moments import CONTACT_LINKS, Meeting, Moments
from foldback.planner.plan.tour import MAX_CAPTION, MAX_STOP_MODULES, MAX_TITLE, Stop, Tour
from foldback.words.certificate import (
    clearance,
    headline,
    label_of,
    main_rows,
    safety,
    torque,
)
from foldback.words.failures import failure
from foldback.words.fold import ShownFold, shown_name
from foldback.words.messages import nearest_frame
from foldback.words.quantities import sentence, spacings

LINKS: Final = ("none", "one", "two", "three", "four")
"""Small numbers as words."""


StopKind = Literal[
    "start",
    "unfolding",
    "first-shape",
    "straight",
    "step",
    "contact",
    "tightest",
    "knot",
    "torque",
    "direct",
    "end",
    "failure",
]


class DraftStop(NamedTuple):
    """A stop of a draft, and what it shows."""

    kind: StopKind
    stop: Stop


def draft_tour(row: ShownFold, frames: int, moments: Moments | None = None) -> Tour | None:
    """Return a tour of a finished fold from straight to folded; None without frames.

    Args:
        row: Facts of the fold.
        frames: Number of frames of its timeline.
        moments: Moments of the fold; without them, the stops come from the certificate only.
    """
    stops = draft_stops(row, frames, moments)
    return Tour(title=_title(row), stops=tuple(stop for _, stop in stops)) if stops else None


def draft_stops(row: ShownFold, frames: int, moments: Moments | None = None) -> list[DraftStop]:
    """Return the stops of ``draft_tour``; none without frames."""
    if not frames:
        return []
    certificate = row.summary.get("certificate") or CertificateFigures()
    if row.status == "failed" or not certificate.get("frames"):
        first, last = _failed(row, frames)
        return [DraftStop("start", first), DraftStop("failure", last)]
    stored_moments = moments or _bare(certificate, frames)
    stops = _start(row, stored_moments)
    end = _done(row, certificate, frames)
    if stored_moments.steps:
        stops += [DraftStop("step", stop) for stop in _steps(stored_moments)]
        return [*stops, DraftStop("end", end)]
    between: dict[StopKind, Stop | None] = {
        "contact": _contact(stored_moments),
        "tightest": _tightest(certificate, stored_moments.plan),
        "knot": _knot(stored_moments),
        "torque": _torque(certificate, stored_moments),
        "direct": _direct(certificate, stored_moments),
    }
    stops += [DraftStop(kind, stop) for kind, stop in between.items() if stop is not None]
    stops.sort(key=lambda draft: draft.stop.frame)
    return [*stops, DraftStop("end", end)]


def _title(row: ShownFold) -> str:
    return clean_name(row.title, max_length=MAX_TITLE) or "A fold"


def _bare(certificate: CertificateFigures, frames: int) -> Moments:
    """Return the moments of a fold for which none are stored: only those of its phases."""
    plan = max(0, frames - (certificate.get("frames") or frames))
    return Moments(plan=plan, straight=plan, frames=frames)


def _start(row: ShownFold, moments: Moments) -> list[DraftStop]:
    joints = row.summary.get("joints")
    chain = row.counted + (f" in a row, with {joints} joints" if joints else "")
    straight = f"The chain is straight: {chain}. Now it folds."
    if not (refold := row.summary.get("refold")):
        if moments.plan:
            straight += " Only this part is the plan for a robot."
        stops = [DraftStop("straight", _stop(straight, moments.straight))]
        return [DraftStop("unfolding", _unfolding(moments)), *stops] if moments.plan else stops
    text = f"First, the chain has another shape: {shown_name(refold['start'])}. It unfolds."
    stops = [DraftStop("first-shape", _stop(text, moments.plan))]
    if moments.straight != moments.plan:  # the frame at which it is straight is known
        stops.append(DraftStop("straight", _stop(straight, moments.straight)))
    return stops


def _unfolding(moments: Moments) -> Stop:
    """Return the stop that plays the search for a motion, from folded to straight."""
    text = (
        "This is the finished shape. Unfolding is easier than folding, so foldback first looks for "
        "a motion that unfolds it. Played backwards, that motion folds the chain."
    )
    return replace(_stop(text, 0), first=1, last=moments.plan)


def _steps(moments: Moments) -> list[Stop]:
    """Return a stop at the end of each step, or of each group of steps if there are many."""
    count = len(moments.steps)
    size = -(-count // 40)
    stops: list[Stop] = []
    for start in range(0, count, size):
        group = moments.steps[start : start + size]
        end = start + len(group)
        joints = tuple(dict.fromkeys(joint + 1 for step in group for joint in step.joints))
        if len(group) == 1:
            text = f"Step {end} of {count}. {group[0].text}"
        else:
            text = f"Steps {start + 1} to {end} of {count}: turns at modules {_listed(joints)}."
        stops.append(_stop(text, group[-1].end, modules=joints[:MAX_STOP_MODULES]))
    return stops


def _listed(modules: tuple[int, ...]) -> str:
    """Return numbers of modules, with the number of those that are left out."""
    listed = ", ".join(map(str, modules[:MAX_STOP_MODULES]))
    hidden = len(modules) - MAX_STOP_MODULES
    return f"{listed} and {hidden} more" if hidden > 0 else listed


def _contact(moments: Moments) -> Stop | None:
    contact = moments.contact
    if contact is None:
        return None
    near = LINKS[CONTACT_LINKS - 1]
    text = (
        f"{sentence(_modules(contact.modules))} are the first whose distance is less than a tenth "
        f"of the spacing. Modules at most {near} places apart in the chain are not counted."
    )
    return _meeting(text, contact)


def _tightest(certificate: CertificateFigures, plan: int) -> Stop | None:
    min_clearance, place = certificate.get("min_clearance"), certificate.get("min_clearance_at")
    if min_clearance is None or place is None or place["modules"] is None:
        return None
    first, second = place["modules"]
    percent = spacings(abs(min_clearance))
    distance = f"overlap by {percent}" if min_clearance < 0.0 else f"are {percent} apart"
    extreme = "largest overlap" if min_clearance < 0.0 else "smallest distance"
    text = f"The {extreme} in the plan: {_modules((first, second))} {distance}."
    proved = clearance(certificate)
    if proved and certificate.get("verified"):
        text += f" The clearance check proved that {proved} during the whole motion."
    meeting = Meeting(frame=nearest_frame(plan + place["frame"]), modules=(first, second))
    return _meeting(text, meeting, colour="clearance")


def _knot(moments: Moments) -> Stop | None:
    if moments.knot is None:
        return None
    text = (
        "Here the chain gets knotted, and it stays knotted to the end: pulling its ends apart "
        "would not straighten it. In the reverse motion, the knot opens here."
    )
    return _stop(text, moments.knot, path=True)


def _torque(certificate: CertificateFigures, moments: Moments) -> Stop | None:
    peak = moments.torque
    if peak is None:
        return None
    if certificate.get("table") is not None:
        label, value = "Largest torque", dict(main_rows(certificate))[label_of("table")]
        subject, colour = "the fold on the table", "joint_torque"
    else:
        label, value = torque(certificate)
        subject, colour = "the fold", "torque"
    if value is None:
        return None
    first, second = peak.modules
    text = (
        f"At this moment, the joint between modules {first + 1} and {second + 1} needs the highest "
        f"torque of {subject}. {label}: {value}."
    )
    return _meeting(text, peak, colour=colour)


def _direct(certificate: CertificateFigures, moments: Moments) -> Stop | None:
    direct = moments.direct
    if direct is None or moments.direct_percent is None:
        return None
    text = (
        "A simpler motion would fail. If all joints turned evenly from straight to folded, "
        f"{_modules(direct.modules)}, the bright blue ones, would run into each other after "
        f"{moments.direct_percent} % of the motion."
    )
    if certificate.get("verified"):
        text += " Here they keep apart."
    return _meeting(text, direct)


def _done(row: ShownFold, certificate: CertificateFigures, frames: int) -> Stop:
    verdict = safety(certificate, row.counted) or sentence(headline(certificate))
    sentences = [f"Done: {_title(row)}", verdict]
    label = label_of("fold_time_s")
    if time := dict(main_rows(certificate))[label]:
        sentences.append(f"{label}: {time}")
    return _stop(f"{'. '.join(sentences)}.", frames - 1)


def _failed(row: ShownFold, frames: int) -> tuple[Stop, ...]:
    """Return the stops of a fold without a verified plan: the first, and that of the failure."""
    first = _stop("The motion begins here. The next stop shows where it fails.", 0)
    reason = failure(row, row.summary)
    if reason is None:
        return (first, _stop("This is the last frame that was computed.", frames - 1))
    at = reason["frame"]
    frame = frames - 1 if at is None else min(frames - 1, nearest_frame(at))
    modules = tuple(module + 1 for module in reason["modules"][:MAX_STOP_MODULES])
    return first, _stop(f"{reason['heading']}. {reason['text']}", frame, modules=modules)


def _modules(modules: tuple[int, int]) -> str:
    return f"modules {modules[0] + 1} and {modules[1] + 1}"


def _meeting(text: str, meeting: Meeting, *, colour: str | None = None) -> Stop:
    return _stop(text, meeting.frame, modules=tuple(k + 1 for k in meeting.modules), colour=colour)


def _stop(
    text: str,
    frame: int,
    *,
    modules: tuple[int, ...] = (),
    colour: str | None = None,
    path: bool = False,
) -> Stop:
    """Return a stop at a frame that is counted from 0."""
    caption = clean_name(text, max_length=MAX_CAPTION)
    return Stop(caption=caption, frame=frame + 1, modules=modules, colour=colour, path=path)
