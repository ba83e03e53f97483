"""Independent checker: it confirms true reasons of failed folds, and no forged reason."""

import itertools
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
import pytest

from foldback import foldback_check, foldback_check_refusals
from foldback.planner.certificate.certificate import certify
from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.explosion.diagnosis import diagnose
from foldback.planner.explosion.peeling.peeling import peel
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.explosion.turning import unfold_in_turns
from foldback.planner.motion.record import Record
from foldback.planner.parameters.explosion import ExplosionParameters, PeelingParameters
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pathfinding.knots import closed_polygons
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.pipeline.stages import run_stages
from foldback.planner.plan.claim import geometry_of
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.shape_writers import write_chain
from foldback.planner.verification.block_evidence import overlap
from foldback.planner.verification.failure_evidence import check_reason
from foldback.planner.verification.knot_invariants import invariants_of
from foldback.planner.verification.plan_failure import reason_of
from tests.planner.chains import anchored, coil, knotted, shuffled
from tests.planner.conftest import Folded
from tests.planner.folds import write_request
from tests.planner.verification.forged_plans import rewrite

Values = dict[str, Any]
Change = Callable[[Values, Values], object]
FEW_STEPS: Final = replace(
    Parameters(), strategy="simultaneous", explosion=ExplosionParameters(max_steps=10)
)
TIGHT: Final = replace(
    Parameters(), peeling=PeelingParameters(unit=8, most_modules=16, window=10, patience=20)
)
"""Parameters of a window in which modules jam."""
TREFOIL: Final = [
    [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)]
    for t in np.arange(12) * np.pi / 6
]


@pytest.fixture(scope="module")
def knot(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Directory of a fold whose chain is a trefoil when its steps are used up."""
    directory = tmp_path_factory.mktemp("knot")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(FoldRequest, "parameters", lambda *_, **__: FEW_STEPS)
        run_stages(write_request(directory, write_chain(knotted(6)), strategy="simultaneous"))
    return directory


@pytest.fixture(scope="module")
def jam(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Plan and record of a box whose modules block each other, in the window and in the core."""
    chain = shuffled((4, 4, 4), 50, 1)
    return store(tmp_path_factory.mktemp("jam"), chain, peel(chain, TIGHT.peeling), TIGHT)


@pytest.fixture(scope="module")
def held_plan(tmp_path_factory: pytest.TempPathFactory) -> FilePath:
    """Plan and record of a cube of 27 modules in which no hinge can make a quarter turn."""
    chain = shuffled((3, 3, 3), 50, 4)
    record = unfold_in_turns(chain, "turns", module_size=0.95, at_once=1, seed=0)
    return store(tmp_path_factory.mktemp("held"), chain, record, replace(Parameters(), at_once=1))


def store(directory: FilePath, chain: Chain, record: Record, parameters: Parameters) -> FilePath:
    """Write plan and record of a failed explosion, as a fold does, and return their directory."""
    diagnosis = diagnose(chain, record, parameters)
    assert diagnosis is not None
    attempts = {**record.summary(), "diagnosis": diagnosis.as_dict()}
    certificate = certify(chain, record, None, parameters)
    plan = Plan.assembled(chain, parameters, 0, record, None, certificate, (attempts,))
    plan.save_npz(directory / "plan.npz")
    record.save(directory / "record.npz")
    return directory


def evidence_of(meta: Values) -> Values:
    evidence_values: Values = meta["attempts"][0]["diagnosis"]["evidence"]
    return evidence_values


def check(directory: FilePath, change: Change | None = None) -> Values:
    """Return the checker's result for a fold whose evidence or other metadata is changed."""
    plan = directory / "plan.npz"
    if change is not None:
        forged = directory / "forged.npz"
        plan = rewrite(plan, forged, lambda _, meta: change(evidence_of(meta), meta))
    try:
        return foldback_check_refusals.check(plan, directory / "record.npz")
    except ValueError as error:
        return {"verdict": "no plan", "reason": str(error)}


def test_knot_of_failed_fold_is_confirmed_from_two_files(
    knot: FilePath, folded: Folded, capsys: Any
) -> None:
    verdict_found = check(knot)
    assert verdict_found["verdict"] == "refusal confirmed", verdict_found
    assert "determinant 3" in verdict_found["because"]
    plan, record = str(knot / "plan.npz"), str(knot / "record.npz")
    assert foldback_check_refusals.main([plan, record]) == 3
    assert "not claimed" in capsys.readouterr().out
    assert foldback_check.main([plan]) == 1
    assert "foldback_check_refusals.py can check" in capsys.readouterr().out
    verdict_found = foldback_check_refusals.check(
        folded.directory / "plan.npz", knot / "record.npz"
    )
    assert (verdict_found["verdict"], verdict_found["reason"]) == (
        "not proved",
        "the plan does not fail",
    )


def test_knot_of_unknown_modules_is_confirmed_with_that_limit(
    knot: FilePath, capsys: pytest.CaptureFixture[str]
) -> None:
    verdict_found = check(knot, lambda _, meta: meta["chain"].update(module="cube\x1b[8m"))
    assert verdict_found["verdict"] == f"refusal confirmed, but {foldback_check.OTHER_MODULE}"
    files = [str(knot / "forged.npz"), str(knot / "record.npz")]
    assert foldback_check_refusals.main(files) == 4
    printed = capsys.readouterr().out
    assert printed.startswith(f"{verdict_found['verdict']}: ")
    assert "\x1b" not in printed


def test_blocked_hinges_and_group_are_confirmed(jam: FilePath) -> None:
    verdict_found = check(jam)
    assert verdict_found["verdict"] == "refusal confirmed", verdict_found
    assert verdict_found["size"] == 0.98
    assert "hinges" in verdict_found["because"] and "any axis" in verdict_found["because"]


@pytest.mark.parametrize("name", ["cube", "tetrahedron", "snake-prism", "snake-cube"])
def test_modules_block_each_other_only_if_all_axes_are_known(name: str) -> None:
    values = geometry_of(module_named(name))
    form = foldback_check.FORMATS["pieces" in values]
    described = foldback_check.geometry(values, form)
    part = described["pieces"][0][0]
    require_all_sides = foldback_check_refusals.require_all_sides
    require_all_sides(foldback_check.Module(described, 0.95))
    for directions in ("faces", "edges"):
        whole = part[directions]
        for k in range(len(whole)):
            part[directions] = np.delete(whole, k, axis=0)
            with pytest.raises(foldback_check.NotProved, match="axes are not known"):
                require_all_sides(foldback_check.Module(described, 0.95))
        part[directions] = whole


def swap(evidence: Values, name: str, **values: Any) -> None:
    evidence[name][0].update(values)


FORGED_KNOTS: Final[dict[str, Change]] = {
    "another determinant": lambda e, t: e.update(determinant=5),
    "no way to join the ends": lambda e, t: e.update(closings=[]),
    "ends that are far apart": lambda e, t: e.update(closings=[[]]),
    "a corner within the chain": lambda e, t: e["closings"][0].__setitem__(1, [4, 4, 1]),
    "a knot outside": lambda e, t: e["closings"][0].__setitem__(
        slice(1, 2), [[900 + 50 * x, 50 * y, 50 * z] for x, y, z in TREFOIL]
    ),
    "corners that are no numbers": lambda e, t: e.update(closings=[[[np.nan] * 3] * 2]),
    "corners too far for rounding": lambda e, t: e.update(
        closings=[[[1e200, 0.0, 0.0], [0.0, 1e200, 0.0]]]
    ),
    "an unknotted shape": lambda e, t: t["chain"].update(folded_rad=[0.0] * 138),
    "another module": lambda e, t: t["chain"].update(module="tetrahedron"),
    "another verdict": lambda e, t: t["certificate"].update(verified=True),
    "another reason": lambda e, t: e.update(kind="blocks"),
    "a reason of no kind": lambda e, t: e.update(kind="magic"),
    "no evidence": lambda e, t: t["attempts"][0]["diagnosis"].update(evidence=None),
    "another attempt": lambda e, t: t["attempts"][0].update(steps=3),
}


@pytest.mark.parametrize("forgery", FORGED_KNOTS)
def test_forged_knot_is_not_confirmed(forgery: str, knot: FilePath) -> None:
    verdict_found = check(knot, FORGED_KNOTS[forgery])
    assert verdict_found["verdict"] in ("not proved", "no plan"), verdict_found


def test_knot_that_the_chain_does_not_have_is_not_confirmed(tmp_path: FilePath) -> None:
    # Its ends extend along free lines, but only another knot would have this determinant.
    chain = coil(40)
    record = explode(chain, FEW_STEPS.explosion)  # type: ignore[arg-type]
    store(tmp_path, chain, record, FEW_STEPS)
    positions = record.frames[-1:].poses(chain).positions[0]
    middle = positions.mean(axis=0)
    polygons = closed_polygons(positions - middle, np.random.default_rng(0))
    corners = [(polygon[len(positions) :] + middle).tolist() for polygon in polygons]

    def claimed(_: Values, meta: Values) -> None:
        evidence: Values = {"kind": "knot", "determinant": 3, "closings": corners}
        meta["attempts"][0]["diagnosis"]["evidence"] = evidence

    assert "no knot: determinant {1}" in check(tmp_path, claimed)["reason"]
    # A trefoil tied by many corners far from the chain is not its knot.
    directory = 0.2 * np.roll(TREFOIL, 1, axis=0) + 1.5 * np.array(corners[0][0])
    ring = np.concatenate([positions, corners[0][:1], directory, corners[0][1:]])
    assert foldback_check_refusals.determinant(ring, 1e-8) == 3
    corners = [ring[len(positions) :].tolist()]
    assert "joined otherwise" in check(tmp_path, claimed)["reason"]
    # A record of another chain of that length, or one that jumps into a knot, is no evidence.
    tied = knotted(6)
    for angles in ([tied.folded_rad], [0.2 * tied.folded_rad, tied.folded_rad]):
        open_chain = replace(tied, folded_rad=0.2 * tied.folded_rad)
        frames = anchored("explosion", np.array(angles))
        jump = replace(record, frames=frames, status="stalled")
        verdict_found = check(store(tmp_path, open_chain, jump, FEW_STEPS))
        assert verdict_found["verdict"] == "not proved"
        assert "start" in verdict_found["reason"] or "no gap" in verdict_found["reason"], (
            verdict_found
        )


FORGED_BLOCKS: Final[dict[str, Change]] = {
    "modules that do not meet": lambda e, t: swap(e, "turns", modules=[0, 63]),
    "another overlap": lambda e, t: swap(e, "turns", overlap=0.2),
    "another hinge": lambda e, t: swap(e, "turns", hinge=110),
    "a hinge left out": lambda e, t: e["turns"].pop(),
    "bent hinges that count as straight": lambda e, t: e.update(bent_above_rad=2.0, turns=[]),
    "released hinges that count as folded": lambda e, t: e.update(
        first_hinge=120, turns=e["turns"][-2:], moves=[]
    ),
    "nothing blocked": lambda e, t: e.update(turns=[], moves=[]),
    "larger modules": lambda e, t: e.update(module_size=1.0),
    "a group without its last modules": lambda e, t: e.update(unit=[48, 54]),
    "a group with released modules": lambda e, t: e.update(unit=[48, 60]),
    "a direction left out": lambda e, t: e["moves"].pop(),
    "a direction twice": lambda e, t: e["moves"].__setitem__(0, e["moves"][1]),
    "a move backwards": lambda e, t: swap(
        e, "moves", moved=-0.5, **{k: e["moves"][1][k] for k in ("modules", "overlap")}
    ),
    "no numbers": lambda e, t: swap(e, "turns", turned_rad=None),
    "another shape": lambda e, t: t["chain"]["folded_rad"].__setitem__(7, 0.1),
}


@pytest.mark.parametrize("forgery", FORGED_BLOCKS)
def test_forged_blocks_are_not_confirmed(forgery: str, jam: FilePath) -> None:
    verdict_found = check(jam, FORGED_BLOCKS[forgery])
    assert verdict_found["verdict"] in ("not proved", "no plan"), verdict_found


def test_forged_blocks_with_true_overlaps_are_not_confirmed(jam: FilePath) -> None:
    plan, record = Plan.load(jam / "plan.npz"), Record.load(jam / "record.npz")
    chain, angles = plan.chain, record.frames.angles_at(plan.chain, -1)
    meta = evidence_of({"attempts": plan.attempts})
    first, move = meta["turns"][0], meta["moves"][0]

    def deepest(poses: Poses, pairs: Iterable[tuple[int, int]]) -> Values:
        computed_overlap = max((overlap(chain, poses, i, j, 0.98), i, j) for i, j in pairs)
        return {"overlap": computed_overlap[0], "modules": list(computed_overlap[1:])}

    def turned(by: float, pairs: Iterable[tuple[int, int]]) -> Values:
        now = angles.copy()
        now[first["hinge"]] += by
        return {"turned_rad": by, **deepest(forward_kinematics(chain.module, now), pairs)}

    def moved(by: float, group: range) -> Values:
        poses = forward_kinematics(chain.module, chain.folded_rad)
        poses.positions[48:] += by * np.array(move["direction"])
        return {"moved": by, **deepest(poses, itertools.product(range(46), group))}

    step, module = first["turned_rad"], first["module"]
    across = list(itertools.product(range(module), range(module + 3, len(chain))))
    for name, forged, words in (
        ("turns", turned(12 * step, across), "a turn by"),
        ("turns", turned(-2 * step, across), "a turn by"),
        ("turns", turned(step, [(0, 63)]), "overlap by"),
        ("moves", moved(2.0, range(48, 56)), "more than a pitch"),
        ("moves", moved(0.5, range(56, 64)), "modules"),
    ):
        verdict_found = check(jam, lambda e, _, name=name, forged=forged: swap(e, name, **forged))
        assert verdict_found["verdict"] == "not proved" and words in verdict_found["reason"], (
            forged,
            verdict_found,
        )


def test_held_hinges_are_confirmed(held_plan: FilePath) -> None:
    plan, notes = Plan.load(held_plan / "plan.npz"), list[str]()
    verdict_found = check(held_plan)
    assert verdict_found["verdict"] == "refusal confirmed", verdict_found
    assert (
        "none of the 79 quarter turns of its 50 hinges, each by itself" in verdict_found["because"]
    )
    reason = reason_of(held_plan, plan, notes)
    assert reason is not None and reason.confirmed, reason
    assert reason.diagnosis.text().startswith(
        "none of the 79 quarter turns of single hinges is free"
    )


FORGED_TURNS: Final[dict[str, Change]] = {
    "modules that do not meet": lambda e, t: swap(e, "turns", modules=[0, 26]),
    "modules on one side": lambda e, t: swap(e, "turns", modules=[5, 9]),
    "an angle without overlap": lambda e, t: swap(e, "turns", turned_rad=-1e-3),
    "another angle": lambda e, t: swap(e, "turns", turned_rad=1.1 * e["turns"][0]["turned_rad"]),
    "more than a quarter": lambda e, t: swap(e, "turns", turned_rad=-2.0),
    "another overlap": lambda e, t: swap(e, "turns", overlap=0.2),
    "a hinge left out": lambda e, t: e.update(turns=[v for v in e["turns"] if v["hinge"] != 7]),
    "a direction left out": lambda e, t: e["turns"].pop(),
    "one direction twice": lambda e, t: e["turns"].__setitem__(1, e["turns"][0]),
    "no turns": lambda e, t: e.update(turns=[]),
    "larger modules": lambda e, t: e.update(module_size=1.0),
    "other modules": lambda e, t: e.update(module_size=0.9),
    "no numbers": lambda e, t: swap(e, "turns", turned_rad=None),
    "another shape": lambda e, t: t["chain"]["folded_rad"].__setitem__(7, 0.1),
}


@pytest.mark.parametrize("forgery", FORGED_TURNS)
def test_forged_turns_are_not_confirmed(forgery: str, held_plan: FilePath) -> None:
    verdict_found = check(held_plan, FORGED_TURNS[forgery])
    assert verdict_found["verdict"] in ("not proved", "no plan"), verdict_found
    plan, notes = Plan.load(held_plan / "forged.npz"), list[str]()
    plain = {**plan.attempts[0]["diagnosis"]}
    record = Record.load(held_plan / "record.npz")
    reason = check_reason(plan.chain, record, plain, plan.parameters)  # type: ignore[arg-type]
    assert reason is not None and not reason.confirmed, notes


def test_true_overlaps_are_no_evidence_after_the_search_has_moved(tmp_path: FilePath) -> None:
    chain = shuffled((3, 3, 3), 50, 4)
    record = unfold_in_turns(chain, "turns", module_size=0.95, at_once=1, seed=0)
    moved = np.array([chain.folded_rad, 0.999 * chain.folded_rad])
    later = replace(record, frames=anchored("explosion", moved))
    verdict_found = check(store(tmp_path, chain, later, replace(Parameters(), at_once=1)))
    assert (
        verdict_found["verdict"] == "not proved"
        and "has left the folded state" in verdict_found["reason"]
    )


def test_free_hinges_and_limits_of_the_search_are_no_reasons(tmp_path: FilePath) -> None:
    chain = coil(12)
    late = explode(chain, FEW_STEPS.explosion)  # type: ignore[arg-type]
    verdict_found = check(store(tmp_path, chain, late, FEW_STEPS))
    assert verdict_found["verdict"] == "not checked"
    assert "not a property of the shape" in verdict_found["reason"]
    frames = anchored("explosion", chain.folded_rad[None])
    store(tmp_path, chain, replace(late, frames=frames), FEW_STEPS)

    def claimed(_: Values, meta: Values) -> None:
        nothing: Values = {"kind": "blocks", "module_size": 0.95, "bent_above_rad": 1.0}
        nothing |= {"first_hinge": len(chain.folded_rad), "turns": [], "moves": [], "unit": None}
        meta["attempts"][0]["diagnosis"]["evidence"] = nothing

    assert check(tmp_path, claimed)["reason"] == "other bent hinges"


def test_ends_are_led_out_along_free_lines_only(knot: FilePath) -> None:
    record, random = Record.load(knot / "record.npz"), np.random.default_rng(1)
    positions = record.frames[-1:].poses(Plan.load(knot / "plan.npz").chain).positions[0]
    middle, outcomes = positions.mean(axis=0), set[tuple[bool, bool, bool]]()
    radius = np.linalg.norm(positions - middle, axis=1).max()
    for kind in np.arange(6) % 3:
        corners = middle + 100.0 * random.normal(size=(2, 3))
        if kind == 1:  # an end passes through the chain
            through = middle + random.normal(size=3) - positions[-1]
            corners[0] = positions[-1] + 150.0 * through / np.linalg.norm(through)
        elif kind == 2:  # the ends are joined through the chain
            corners[1] = 2.0 * middle - corners[0] + 3.0 * random.normal(size=3)
        ring = np.concatenate([positions, corners])
        value = foldback_check_refusals.determinant(ring, 1e-8)
        second = {"closings": [corners.tolist()], "determinant": value}
        verdict_found = check(knot, lambda e, _, second=second: e.update(second))
        share = np.linspace(0.0, 1.0, 2001)[:, None]
        lines = [a + share * (b - a) for a, b in zip(ring[-3:], [*ring[-2:], ring[0]], strict=True)]
        nearest = [
            np.linalg.norm(lines[k][:, None] - moved_positions, axis=2).min()
            for k, moved_positions in ((0, positions[:-1]), (1, middle[None]), (2, positions[1:]))
        ]
        free, around = min(nearest[0], nearest[2]) >= 0.5, nearest[1] >= radius
        confirmed = verdict_found["verdict"] == "refusal confirmed"
        assert confirmed is bool(free and around and value > 1), verdict_found
        outcomes.add((bool(free), bool(around), value > 1))
    assert outcomes >= {(True, True, True), (True, False, True), (False, True, True)}


def test_stricter_verdict_stands(knot: FilePath, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, notes = Plan.load(knot / "plan.npz"), list[str]()
    confirmed = reason_of(knot, plan, notes)
    assert confirmed is not None and confirmed.confirmed, confirmed
    unproved = {"verdict": "not proved", "reason": "why"}
    monkeypatch.setattr(foldback_check_refusals, "check", lambda *_, **__: unproved)
    refuted = reason_of(knot, plan, notes)
    assert refuted is not None and "does not confirm the reason: why" in refuted.differences[0]


def test_determinants_agree_with_those_of_the_planner() -> None:
    random, knots = np.random.default_rng(5), 0
    for _ in range(10):
        polygon = random.normal(size=(int(random.integers(6, 30)), 3))
        determinant = foldback_check_refusals.determinant(polygon, 1e-9)
        exact = invariants_of(polygon, random)
        assert exact is not None and determinant == exact.determinant
        knots += determinant > 1
    assert 2 < knots < 8
    assert foldback_check_refusals.determinant(np.array(TREFOIL, float), 1e-9) == 3


def test_line_that_meets_itself_has_no_determinant() -> None:
    polygon = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 1], [1, 1, 0], [1, -1, 0], [0, -1, 3]], float)
    touching = polygon.copy()
    touching[3:5] = [1.0, 1e-7, 0.0], [2.0, 3.0, 0.0]
    for points in (polygon, polygon + 1e-7 * np.eye(6, 3, -3), touching):
        with pytest.raises(foldback_check.NotProved, match="no view"):
            foldback_check_refusals.determinant(points, 1e-6)
