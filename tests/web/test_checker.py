"""The pages' checker: it proves the same plans as ``foldback_check.py``, and no forged one."""

import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.clearance.forgeries import certainly_false
from foldback import foldback_check
from foldback.planner.certificate.frame_figures import clearances_of
from foldback.planner.chain.built_in_modules import module_named
from foldback.planner.chain.chain import Chain
from tests.case import case
from tests.planner.peels import snake
from tests.planner.verification import strange_plans
from tests.planner.verification.forged_plans import (
    FALSE,
    MOTIONS,
    Arrays,
    Meta,
    forge,
    rewrite,
    save,
    select,
)
from tests.web.node import JavaScriptChecker

SEED = 20
BETWEEN = np.linspace(0.0, 1.0, 6)


@pytest.fixture(scope="module")
def checker() -> Iterator[JavaScriptChecker]:
    with JavaScriptChecker() as checker:
        yield checker


def by_python(path: Path) -> dict[str, Any]:
    """Return the verdict of the other checker, and its findings."""
    try:
        return foldback_check.check(path)
    except ValueError as error:
        return {"verdict": "no plan", "reason": str(error)}


@pytest.fixture(scope="module")
def plans(ring: Path, kinematic: Path, peeled: Path) -> list[Path]:
    return [fold / "plan.npz" for fold in (ring, kinematic, peeled)]


def test_both_checkers_prove_the_same(plans: list[Path], checker: JavaScriptChecker) -> None:
    for path in plans:
        browser_check, python_check = checker(path), by_python(path)
        assert python_check["verdict"] == "proved", path
        assert browser_check["proved"], browser_check
        assert browser_check["claim"] == python_check["clearance"] <= browser_check["least"]
        assert browser_check["tightest"]["gap"] == pytest.approx(
            python_check["tightest"]["gap"], rel=0.1
        )
        assert browser_check["frames"] >= python_check["frames"] - 1
        assert browser_check["pairs"] == pytest.approx(python_check["looks"], rel=0.05)


def test_modules_are_made_larger_until_two_touch(plans: list[Path]) -> None:
    with JavaScriptChecker("size") as checker:
        largest = [checker(path) for path in plans]
    for path, largest_clearance in zip(plans, largest, strict=True):
        plan = foldback_check.Plan(path)
        assert plan.size < largest_clearance["size"] <= 1.0
        assert proved_clearance(plan) > 0.0
        # a little larger, and the named modules touch
        at = largest_clearance["touch"]
        assert at["size"] == pytest.approx(largest_clearance["size"], abs=2e-4)
        chain, angles = sample(plan, [at["frame"]])
        clearance, _ = clearances_of(chain, angles, module_size=min(at["size"] + 1e-4, 1.0))
        assert clearance[0, at["modules"]].max() <= 1e-4


def sample(plan: foldback_check.Plan, frames: Iterable[float]) -> tuple[Chain, np.ndarray]:
    """Return the chain of a plan, and its angles at and between frames."""
    ends = np.array([plan.angles(k, plan.pad, len(plan.folded)) for k in range(plan.frames)])
    low = np.minimum(np.floor(list(frames)).astype(int), plan.frames - 1)
    high = np.minimum(low + 1, plan.frames - 1)
    share = (np.array(list(frames)) - low)[:, None]
    chain = Chain.from_angles(module_named(plan.kind), plan.folded[plan.pad :])
    return chain, ends[low] + share * (ends[high] - ends[low])


def proved_clearance(plan: foldback_check.Plan) -> float:
    """Return the smallest clearance that the planner finds at and between frames."""
    frames = (np.arange(plan.frames - 1)[:, None] + BETWEEN).ravel()
    return float(clearances_of(*sample(plan, frames), module_size=plan.size)[0].min())


def test_no_forged_plan_is_proved(
    plans: list[Path], checker: JavaScriptChecker, tmp_path: Path
) -> None:
    kinds, refused = (*FALSE, *MOTIONS), 0
    for seed in range(2 * len(kinds)):
        path, random = tmp_path / "plan.npz", np.random.default_rng(SEED + seed)
        kind = forge(plans[seed % len(plans)], path, random, kinds[seed // 2])
        browser_check = checker(path)
        assert browser_check["proved"] == (by_python(path)["verdict"] == "proved"), (
            kind,
            seed,
            browser_check,
        )
        refused += not browser_check["proved"]
        if browser_check["proved"]:
            assert kind not in FALSE, (kind, seed)
            assert not certainly_false(path), (kind, seed, browser_check)
    assert refused > len(kinds)


def test_strange_files_get_the_same_verdict_from_both_checkers(
    checker: JavaScriptChecker, tmp_path: Path
) -> None:
    path = tmp_path / "plan.npz"
    true = {name: (way, strange_plans.PROVED) for name, way in strange_plans.TRUE.items()}
    for name, (way, expected) in (strange_plans.STRANGE | true).items():
        strange_plans.write(way, path)
        with case(name):
            python_values, other_checker = by_python(path), checker(path)
            assert python_values["verdict"] == other_checker["verdict"] == expected, (
                python_values,
                other_checker,
            )
            words = [
                text
                for text in (*python_values.values(), *other_checker.values())
                if isinstance(text, str)
            ]
            assert "".join(words).isprintable()
            if expected.startswith("proved"):
                same_columns = ("start", "end", "module")
                assert [python_values[key] for key in same_columns] == [
                    other_checker[key] for key in same_columns
                ]
                assert python_values["reason"] == other_checker["limits"]


def test_reasons_are_the_same_and_count_from_1(checker: JavaScriptChecker, tmp_path: Path) -> None:
    # The second of four cubes bends, which brings the first and third together.
    path = save(tmp_path / "plan.npz", np.array([[0.0] * 4, [0.5, 0.0, 0.0, 0.0]]), claim=1.04)
    gap = r"modules 1 and 3: no gap above 0\.\d{9} at frame 1\.50000"
    step = "a hinge turns by 0.500000 rad between two frames, more than the plan states"
    for change, expected in (
        ({"module_size": 0.95}, gap),
        ({"clearance_bound": 0.01, "max_joint_step_rad": 0.4}, step),
    ):
        rewrite(path, path, lambda _, meta, new=change: meta["certificate"].update(new))
        reason = by_python(path)["reason"]
        assert re.fullmatch(expected, reason), reason
        assert checker(path)["text"] == f"{reason}."


def test_pairs_at_rest_are_checked_at_first(checker: JavaScriptChecker, tmp_path: Path) -> None:
    """One module rotates at the end of a folded box: at first, all pairs in the box are checked."""
    folded = snake((10, 10, 8)).folded_rad
    last = np.array([-0.3, 0.0]) * [[1.0], [0.5], [0.0]] + folded[-2:]
    path = save(tmp_path / "plan.npz", np.vstack([folded] * len(last)))

    def window(arrays: Arrays, meta: Meta) -> None:
        arrays.pop("joint_angles_rad")
        arrays["first"] = np.full(len(last), len(folded) - 2)
        arrays["offsets"] = np.arange(len(last) + 1) * 2
        arrays["angles_rad"] = last.ravel().astype("f4")
        meta["start"] = {"folded_rad": [*folded[:-2], *last[0]]}

    browser_check, python_check = checker(rewrite(path, path, window)), by_python(path)
    assert browser_check["verdict"] == python_check["verdict"] == strange_plans.START, (
        browser_check,
        python_check,
    )
    assert browser_check["pairs"] == python_check["looks"] > 14 * foldback_check.CROWD, (
        "more than for 1 + 10 modules"
    )


@pytest.mark.parametrize("change", [{"apart": 9}, {"apart": 0}, {"rigid_links": -1}])
def test_custom_module_exempts_no_more_pairs(
    change: dict[str, Any], kinematic: Path, checker: JavaScriptChecker, tmp_path: Path
) -> None:
    def own(_: Arrays, meta: Meta) -> None:
        geometry = meta["claim"]["module"] | change
        meta["chain"]["module"] = "brick"
        meta["claim"]["module"] = geometry
        apart = geometry["apart"]
        meta["certificate"]["exempt_pairs"] = {"apart": apart, "count": (apart - 1) * 7}

    assert not checker(rewrite(kinematic / "plan.npz", tmp_path / "own.npz", own))["proved"]


def test_no_bound_exceeds_the_sampled_clearance(
    ring: Path, checker: JavaScriptChecker, tmp_path: Path
) -> None:
    """With few frames, hinges rotate far between frames, and interpolation weakens the bounds."""
    for stride in (2, 3, 5, 8, 12):

        def thin_out(arrays: Arrays, meta: Meta, stride: int = stride) -> None:
            last = len(arrays["time_s"]) - 1
            select(arrays, np.array([*range(0, last, stride), last]))
            meta["certificate"] |= {"clearance_bound": 1e-3, "max_joint_step_rad": None}

        path = rewrite(ring / "plan.npz", tmp_path / "few.npz", thin_out)
        browser_check = checker(path)
        assert browser_check["proved"] == (by_python(path)["verdict"] == "proved")
        if browser_check["proved"]:
            assert browser_check["bounds"] > 100
            assert browser_check["above"] == 0
            assert browser_check["least"] <= proved_clearance(foldback_check.Plan(path)) + 1e-6
