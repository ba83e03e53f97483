"""Forged folds: each false statement in a fold's directory is found, although the digests fit."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.path import Path
from foldback.planner.pipeline.derived_files import complete
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_path
from foldback.planner.verification.verify import verify
from tests.case import case
from tests.planner.folds import run_fold
from tests.planner.tampering import edit_folder
from tests.planner.verification.test_verify import edit_plan, findings, forge

BOX = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 1, 1), (1, 1, 1), (1, 0, 1), (0, 0, 1)]
ROW = [(x, 0, 0) for x in range(7)] + [(6, 1, 0)]
SHAPE = json.dumps(BOX).encode()
"""The box, without a name: its file names it."""
Change = Callable[[FilePath], Any]


@pytest.fixture(scope="module")
def whole_plan(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Verified fold of a box; tests must not change it."""
    place = tmp_path_factory.mktemp("whole") / "fold"
    run_fold(place, SHAPE, filename="box.json", strategy="simultaneous", settings="robots=2")
    complete(place)
    return place


def json_with(name: str, change: Callable[[Any], Any]) -> Change:
    """Return a forgery of a JSON file; ``change`` returns other values, or changes them."""

    def forged(place: FilePath) -> None:
        values = json.loads((place / name).read_bytes())
        values = change(values) or values
        (place / name).write_text(json.dumps(values))

    return forged


def plan_with(change: Callable[[dict[str, Any]], Any]) -> Change:
    """Return a forgery of all files that hold the plan's values."""

    def forged(place: FilePath) -> None:
        edit_plan(place, change)
        values = Plan.load(place / "plan.npz").as_dict()
        (place / "attempts.json").write_text(json.dumps(values["attempts"]))

    return forged


def bytes_of(data: bytes) -> Change:
    return lambda place: (place / "input").write_bytes(data)


def figure(name: str, factor: float) -> Change:
    """Return a forgery of a figure of the certificate."""
    return plan_with(
        lambda plan: plan["certificate"].update({name: plan["certificate"][name] * factor})
    )


def margin(name: str, **values: Any) -> Change:
    return plan_with(lambda plan: plan["certificate"]["margins"][name].update(values))


def attempt(**values: Any) -> Change:
    return plan_with(lambda plan: plan["attempts"][0].update(values))


def curve(name: str) -> Change:
    def forged(place: FilePath) -> None:
        def edit(arrays: dict[str, Any]) -> None:
            if name in arrays:
                arrays[name] = arrays[name] * 2 + 1

        edit_folder(place / "figures", edit)

    return forged


def perfect_robots(place: FilePath) -> None:
    """Make the robots that are not shown perfect, with a certificate computed from that."""
    playback = Workspace(place).read_playback()
    assert playback is not None and playback.others_rad is not None
    planned = playback.reference.joint_angles_rad
    forge(place, others_rad=np.array([planned] * len(playback.others_rad)))


def with_manner(name: str, value: Any) -> Change:
    """Return a forgery of a field of the request."""
    return json_with("request.json", lambda values: values.update({name: value}))


@dataclass(frozen=True)
class Forgery:
    """One forgery.

    Attributes:
        change: Changes the files of a directory.
        words: Words of a problem that verification finds.
    """

    change: Change
    words: str


OTHER = write_path(Path.from_cells(ROW, name="box"))
FORGERIES = {
    "input: another shape": Forgery(bytes_of(OTHER), "input was read again"),
    "input: other end": Forgery(bytes_of(json.dumps(BOX[::-1]).encode()), "input was read again"),
    "input: mirrored": Forgery(
        bytes_of(json.dumps([(-x, y, z) for x, y, z in BOX]).encode()), "input was read again"
    ),
    "input: one module less": Forgery(bytes_of(json.dumps(BOX[:-1]).encode()), "input was read"),
    "input: hello": Forgery(bytes_of(b"hello"), "input: the shape cannot be read again"),
    "input: empty": Forgery(bytes_of(b""), "input: the shape cannot be read again"),
    "input: a picture": Forgery(bytes_of(b"\x89PNG\r\n\x1a\n"), "cannot be read again"),
    "request: name": Forgery(with_manner("filename", "cat.json"), "input was read again"),
    "request: voxels": Forgery(with_manner("as_voxels", True), "input was read again"),
    "request: start": Forgery(with_manner("start", [1, 1, 1]), "input"),
    "request: module": Forgery(with_manner("module", "tetrahedron"), "input"),
    "request: seed": Forgery(with_manner("seed", 5), "request"),
    "request: strategy": Forgery(with_manner("strategy", "peel"), "parameters"),
    "request: preference": Forgery(with_manner("prefer", "time"), "parameters"),
    "request: settings": Forgery(with_manner("settings", "robots=1"), "parameters"),
    "request: size": Forgery(with_manner("module_size", 0.9), "parameters"),
    "seed everywhere": Forgery(
        lambda place: (
            with_manner("seed", 5)(place),
            plan_with(lambda plan: plan.update(seed=5))(place),
        ),
        "attempts[0].seed",
    ),
    "seed and attempts": Forgery(
        lambda place: (
            with_manner("seed", 5)(place),
            plan_with(lambda plan: (plan.update(seed=5), plan["attempts"][0].update(seed=5)))(
                place
            ),
        ),
        "a repeated simulation differ in",
    ),
    "candidates: ends": Forgery(
        json_with("candidates.json", lambda values: values.update(two_ended=False)), "two_ended"
    ),
    "candidates: one more": Forgery(
        json_with("candidates.json", lambda values: values["chains"].append(values["chains"][0])),
        "candidates.json.chains: got 2 entries, expected 1",
    ),
    "moments: all later": Forgery(
        json_with(
            "moments.json",
            lambda values: {
                name: {**value, "frame": value["frame"] + 7} if isinstance(value, dict) else value
                for name, value in values.items()
            },
        ),
        "moments.json",
    ),
    "moments: straight": Forgery(
        json_with("moments.json", lambda values: values.update(straight=0)), "moments.json.straight"
    ),
    "moments: direct": Forgery(
        json_with("moments.json", lambda values: values.update(direct_percent=99)),
        "moments.json.direct_percent",
    ),
    "moments: knot": Forgery(
        json_with("moments.json", lambda values: values.update(knot=3, determinant=3)),
        "moments.json.knot",
    ),
    "moments: modules": Forgery(
        json_with("moments.json", lambda values: values["torque"].update(modules=[0, 1])),
        "moments.json.torque",
    ),
    "plots: torque": Forgery(curve("peak_torque_nm"), "figures peak_torque_nm"),
    "plots: clearance": Forgery(curve("min_clearance"), "figures min_clearance"),
    "plots: hinges": Forgery(curve("hinges_moving"), "figures hinges_moving"),
    "attempts: strategy": Forgery(attempt(strategy="peel"), "attempts[0].strategy"),
    "attempts: gentle": Forgery(attempt(gentle=True), "attempts[0].gentle"),
    "attempts: candidate": Forgery(attempt(candidate=1), "attempts[0].candidate"),
    "attempts: end": Forgery(attempt(other_end=True), "attempts[0].other_end"),
    "attempts: finer": Forgery(attempt(finer=4), "attempts[0].finer"),
    "attempts: patience": Forgery(attempt(patience=1), "attempts[0].patience"),
    "attempts: steps": Forgery(attempt(steps=1), "none of them has the figures"),
    "attempts: verdict": Forgery(attempt(verified=False), "none of them has the figures"),
    "attempts: tripled": Forgery(
        plan_with(lambda plan: plan.update(attempts=plan["attempts"] * 3)), "no more attempts"
    ),
    "attempts: none": Forgery(
        plan_with(lambda plan: plan.update(attempts=[])), "none of them has the figures"
    ),
    "attempts: figures": Forgery(
        plan_with(lambda plan: plan["attempts"][0]["figures"].update(fold_time_s=1.0)),
        "attempts[0].figures.fold_time_s",
    ),
    "margin: size": Forgery(margin("module_size", value=0.97), "margins.module_size"),
    "margin: larger": Forgery(margin("one_hinge_rad", value=0.2), "which cannot be proved"),
    "margin: smaller": Forgery(margin("one_hinge_rad", value=1e-4), "margins.one_hinge_rad"),
    "margin: independent": Forgery(margin("independent_rad", value=1e-6), "independent_rad"),
    "margin: place": Forgery(
        margin("one_hinge_rad", limited_by={"frame": 0.0, "modules": [0, 7]}), "limited_by"
    ),
    "margin: frame": Forgery(
        margin("module_size", limited_by={"frame": 1e6, "modules": [0, 7]}), "limited_by"
    ),
    "margin: probability": Forgery(
        plan_with(lambda plan: plan["certificate"]["margins"].update(failure_probability=0.01)),
        "failure_probability",
    ),
    "robots: perfect": Forgery(perfect_robots, "a repeated simulation differ in others_rad"),
    "robots: error": Forgery(
        lambda place: forge(place, max_angle_error_rad=1.0), "max_angle_error_rad"
    ),
    "robots: torque": Forgery(
        lambda place: forge(place, peak_torque=1e-6, rms_torque=1e-7), "differ in peak_torque"
    ),
    "robots: position": Forgery(
        lambda place: forge(place, rms_position_error=1e-9), "rms_position_error"
    ),
    "certificate: clearance": Forgery(figure("min_clearance", 1.01), "certificate.min_clearance"),
    "certificate: bound": Forgery(figure("clearance_bound", 1.02), "clearance_bound"),
    "certificate: time": Forgery(figure("fold_time_s", 0.5), "certificate.fold_time_s"),
    "certificate: torque": Forgery(figure("peak_torque_nm", 0.5), "certificate.peak_torque_nm"),
    "certificate: verdict": Forgery(
        plan_with(
            lambda plan: plan["certificate"].update(
                reason={"code": "plan-end", "values": {}}, verified=False
            )
        ),
        "certificate.reason",
    ),
    "certificate: exempt": Forgery(
        plan_with(lambda plan: plan["certificate"]["exempt_pairs"].update(rule="all pairs")),
        "certificate.exempt_pairs.rule",
    ),
    "claim: format": Forgery(
        plan_with(lambda plan: plan["claim"].update(format="foldback-claim/9")), "claim"
    ),
    "plan: refold": Forgery(
        plan_with(lambda plan: plan.update(start=plan["chain"])), "request.json"
    ),
    "plan: name": Forgery(plan_with(lambda plan: plan["chain"].update(name="cat")), "chain"),
}
"""Forgeries by name; ``test_verify`` has those of motions and models."""


FAMILIES = (
    *(("input",), ("attempts",), ("moments", "plots"), ("margin",)),
    *(("certificate",), ("candidates", "claim")),
)
"""Kinds of forgeries that different checks find: one of each shares a directory, to save time."""


def batches() -> Iterator[tuple[str, ...]]:
    """Yield the names of the forgeries of each directory."""
    families = [
        [name for name in FORGERIES if name.partition(":")[0] in kinds] for kinds in FAMILIES
    ]
    for names in zip_longest(*families):
        yield tuple(filter(None, names))
    together = {name for names in families for name in names}
    for name in FORGERIES:
        if name not in together:
            yield (name,)


@pytest.mark.parametrize("names", [*batches()], ids=", ".join)
def test_forged_fold_is_not_verified(
    whole_plan: FilePath, tmp_path: FilePath, names: tuple[str, ...]
) -> None:
    place = FilePath(shutil.copytree(whole_plan, tmp_path / "fold"))
    for name in names:
        FORGERIES[name].change(place)
    computed_findings = findings(place)
    for name in names:
        assert FORGERIES[name].words in computed_findings, name


def test_each_unchecked_value_is_named(whole_plan: FilePath, tmp_path: FilePath) -> None:
    verification = verify(whole_plan)
    assert (verification.verified, verification.robots_repeated) == (True, True)
    assert "Reported only" in verification.notes[-1]
    for missing, note in (
        ("input", "nothing shows that the plan is of the shape"),
        ("record.npz", "the robots was not repeated, because there is no record.npz"),
        ("playback.npz", "the robots was not repeated, because there is no playback.npz"),
    ):
        with case(missing):
            place = FilePath(shutil.copytree(whole_plan, tmp_path / missing))
            (place / missing).unlink()
            verification = verify(place)
            assert note in str(verification.notes)
            assert verification.robots_repeated is (missing == "input")


def test_texts_of_files_are_escaped(whole_plan: FilePath, tmp_path: FilePath) -> None:
    place = FilePath(shutil.copytree(whole_plan, tmp_path / "fold"))
    hostile = "\x1b[2J\x07verified"
    json_with("manifest.json", lambda values: values["sha256"].update({hostile: {hostile: ""}}))(
        place
    )
    json_with("attempts.json", lambda values: values[0].update({hostile: hostile}))(place)
    verification = verify(place)
    for text in (*verification.problems, *verification.notes, *verification.checked):
        assert text.isprintable()
    assert "verified" in str(verification.problems)
