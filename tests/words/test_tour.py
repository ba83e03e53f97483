"""Tours: which ones are accepted, and the draft for a fold."""

import json
import re
from dataclasses import replace
from typing import Any, cast

import pytest

from foldback.planner.certificate.figures import CertificateFigures, FoldSummary
from foldback.planner.errors import InputError
from foldback.planner.plan.moments import Meeting, Moments, StepMoment
from foldback.planner.plan.tour import MAX_CAPTION, MAX_STOPS, TOUR_FORMAT, Tour
from foldback.words.certificate import clearance, torque
from foldback.words.fold import ShownFold
from foldback.words.tour import draft_tour
from tests.case import case
from tests.words.test_certificate import SIMULATED

STOP: dict[str, Any] = {"caption": "It folds.", "frame": 3}
FULL: dict[str, Any] = {
    **STOP,
    **{"modules": [1, 9], "from": 2, "to": 7, "camera": "-62.5,24,1.2", "follow": False},
    **{"colour": "clearance", "path": True},
}
CERTIFICATE: dict[str, Any] = {
    **SIMULATED,
    "min_clearance_at": {"frame": 507.5, "modules": [20, 31]},
    "fold_time_s": 23.885,
    "joint_speed_limit_rad_s": 1.0,
}


def known(**summary: Any) -> FoldSummary:
    """Return the known values of a fold."""
    return cast(FoldSummary, summary)


FOLD = ShownFold(
    id="fold",
    name="wrench-160",
    status="verified",
    modules=160,
    preset="default",
    seed=0,
    summary=known(joints=158, certificate=CERTIFICATE),
)
MOMENTS = Moments(
    plan=964,
    straight=964,
    frames=5000,
    contact=Meeting(frame=2000, modules=(3, 58)),
    torque=Meeting(frame=1500, modules=(79, 80)),
    knot=3000,
    determinant=3,
    direct=Meeting(frame=2500, modules=(5, 90)),
    direct_percent=42,
)


def tour(**changes: Any) -> dict[str, Any]:
    """Return a tour of one stop with other values, without those that are None."""
    values = {"format": TOUR_FORMAT, "title": "Wrench", "stops": [STOP], **changes}
    return {name: value for name, value in values.items() if value is not None}


def test_tours_are_read_as_written() -> None:
    for stop in (STOP, FULL):
        values = tour(stops=[stop, STOP])
        read = Tour.from_dict(values, frames=7, modules=9)
        assert json.loads(json.dumps(read.as_dict())) == values
        assert Tour.from_dict(read.as_dict()) == read


def test_invalid_tour_is_refused_with_its_place() -> None:
    wrong: list[tuple[Any, str]] = [
        ([], "tour"),
        (tour(format="foldback-tour/2"), "format"),
        (tour(more=1), "tour"),
        *((tour(title=title), "title") for title in (None, "\u200b", "x" * 201)),
        *((tour(stops=stops), "stops") for stops in ([], {}, [STOP] * (MAX_STOPS + 1))),
        (tour(stops=[STOP, 7]), "stop 2"),
    ]
    values: dict[str, tuple[Any, ...]] = {
        "caption": (None, " \n", "x" * (MAX_CAPTION + 1), "\u202e" * 10_000 + "x"),
        "frame": (0, 8, 1.5, True),
        "modules": ([], [10], list(range(1, 10))),
        "camera": ("1,2", "1,2,x", "1,2,3\n"),
        **{"colour": ("<b>",), "follow": (0,), "path": ("yes",), "from": (2,)},
    }
    changes: list[tuple[dict[str, Any], str]] = [
        *(({name: value}, name) for name, element in values.items() for value in element),
        ({"more": 1}, "stop 1"),
        ({"from": 3, "to": 3}, "from"),
        ({"from": 3, "to": 8}, "to"),
    ]
    wrong += [(tour(stops=[{**STOP, **change}]), place) for change, place in changes]
    for wrong_one, place in wrong:
        with case(wrong_one), pytest.raises(InputError) as caught:
            Tour.from_dict(wrong_one, frames=7, modules=9)
        assert caught.value.code == "bad-tour"
        assert place in str(caught.value.where)


def test_invisible_characters_are_removed_from_captions() -> None:
    read = Tour.from_dict(tour(stops=[{**STOP, "caption": "a\u202e \n <b>b</b>"}]))
    assert read.stops[0].caption == "a <b>b</b>"


def test_draft_has_each_moment_in_order_with_the_figures_of_the_certificate() -> None:
    drafted = draft_tour(FOLD, 5000, MOMENTS)
    assert drafted is not None
    assert drafted.title == "Wrench"
    certificate = cast(CertificateFigures, CERTIFICATE)
    frames = [(stop.frame, stop.modules) for stop in drafted.stops]
    pairs = {1473: (21, 32), 1501: (80, 81), 2001: (4, 59), 2501: (6, 91)}
    assert frames == [(1, ()), (965, ()), *pairs.items(), (3001, ()), (5000, ())]
    texts = [stop.caption for stop in drafted.stops]
    unfolding, straight, *_ = drafted.stops
    assert (unfolding.first, unfolding.last) == (1, 964)
    assert "motion that unfolds it" in unfolding.caption
    assert "160 cubes in a row, with 158 joints" in straight.caption
    assert "Only this part is the plan for a robot" in straight.caption
    assert "modules 21 and 32 are 4.89 % of the spacing apart" in texts[2]
    assert str(clearance(certificate)) in texts[2]
    assert texts[3].endswith("{}: {}.".format(*torque(certificate)))
    assert "modules 6 and 91, the bright blue ones, would run into each other" in texts[5]
    assert texts[5].endswith("after 42 % of the motion. Here they keep apart.")
    assert "Folding time: 23.9 s at joint speeds of up to 1 rad/s" in texts[7]
    assert Tour.from_dict(drafted.as_dict()) == drafted


def test_draft_claims_nothing_that_is_unknown() -> None:
    bare = draft_tour(FOLD, 5000)
    assert bare is not None
    assert [stop.frame for stop in bare.stops] == [1, 965, 1473, 5000]
    assert draft_tour(FOLD, 0) is None

    certificate = {**CERTIFICATE, "verified": False, "min_clearance": -0.02}
    failed = replace(FOLD, status="failed", summary=known(certificate=certificate))
    refused = draft_tour(failed, 5000, MOMENTS)
    assert refused is not None
    captions = " ".join(stop.caption for stop in refused.stops)
    assert not re.search("proved|[Vv]erified[^.]*:|Done", captions)


def test_longest_name_leaves_a_tour() -> None:
    long = draft_tour(replace(FOLD, name="é" * 200, renamed=True), 5000, MOMENTS)
    assert long is not None
    assert Tour.from_dict(long.as_dict()) == long
    assert max(len(stop.caption) for stop in long.stops) <= MAX_CAPTION


def test_draft_of_a_plan_that_rests_shows_its_steps() -> None:
    for count in (3, 90):
        steps = tuple(
            StepMoment(
                start=1000 + 10 * k, end=1010 + 10 * k, text="Turn.", joints=(k,), moving=((0, k),)
            )
            for k in range(count)
        )
        drafted = draft_tour(FOLD, 5000, replace(MOMENTS, steps=steps))
        assert drafted is not None
        assert len(drafted.stops) <= MAX_STOPS
        assert Tour.from_dict(drafted.as_dict(), frames=5000, modules=160) == drafted
        stops = drafted.stops[2:-1]
        if count == 3:
            assert [stop.caption for stop in stops] == [f"Step {k} of 3. Turn." for k in (1, 2, 3)]
            assert [(stop.frame, stop.modules) for stop in stops] == [
                (1011 + 10 * k, (k + 1,)) for k in range(3)
            ]
        else:
            assert stops[0].caption == "Steps 1 to 3 of 90: turns at modules 1, 2, 3."
            assert (len(stops), stops[-1].frame) == (30, 1000 + 10 * 90 + 1)
