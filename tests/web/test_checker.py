"""The pages' checker proves what ``foldback_check.py`` proves, and no plan that was forged."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import foldback_check
from planner.certificate.measure import clearances_of
from planner.chain.chain import Chain
from planner.chain.module import CUBE, TETRAHEDRON
from tests.web.test_javascript import NODE

HERE = Path(__file__).parent
STORED = HERE.parent / "planner" / "certificate" / "earlier_plans"
PLANS = {name: STORED / f"{name}.npz" for name in ("ring-12-frames", "box-8-windows")}
MODULES = {"cube": CUBE, "tetrahedron": TETRAHEDRON}
SEED = 20
FORGED = 60
BETWEEN = np.linspace(0.0, 1.0, 6)
Random = np.random.Generator
Arrays = dict[str, Any]
Change = Callable[[Arrays, dict[str, Any], Random], None]


def verdicts(paths: Iterable[Path], way: str = "claim") -> list[dict[str, Any]]:
    """What node says of each plan."""
    asked = [NODE, HERE / "check" / "verdicts.js", way, *paths]
    done = subprocess.run(asked, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


def python_says(path: Path) -> dict[str, Any]:
    """The verdict of the other checker, and what it came across."""
    try:
        return foldback_check.check(path)
    except ValueError:
        return {"verdict": "no plan"}


@pytest.fixture(scope="module")
def plans(peeled: Path) -> list[Path]:
    return [*PLANS.values(), peeled / "plan.npz"]


def test_both_checkers_prove_the_same(plans: list[Path]) -> None:
    for path, found in zip(plans, verdicts(plans), strict=True):
        other = python_says(path)
        assert other["verdict"] == "proved", path
        assert found["proved"], found
        assert found["claim"] == other["clearance"] <= found["least"]
        assert found["tightest"]["gap"] == pytest.approx(other["tightest"]["gap"], rel=0.1)
        assert found["frames"] >= other["frames"] - 1
        assert found["pairs"] == pytest.approx(other["looks"], rel=0.01)


def test_modules_are_made_larger_until_two_touch(plans: list[Path]) -> None:
    for path, found in zip(plans, verdicts(plans, "size"), strict=True):
        plan = foldback_check.Plan(path)
        assert plan.size < found["size"] <= 1.0
        assert proved_clearance(plan) > 0.0
        # A little larger, and the modules that are named touch.
        at = found["touch"]
        assert at["size"] == pytest.approx(found["size"], abs=2e-4)
        chain, angles = sampled(plan, [at["frame"]])
        clearance, _ = clearances_of(chain, angles, size=min(at["size"] + 1e-4, 1.0))
        assert clearance[0, at["modules"]].max() <= 1e-4


def sampled(plan: foldback_check.Plan, frames: Iterable[float]) -> tuple[Chain, np.ndarray]:
    """The chain of a plan, and its angles at moments, also between frames."""
    motion, pad = plan.motion, plan.module.rigid * len(plan.module.names)
    ends = np.array([motion.angles(k, pad, motion.slots) for k in range(motion.frames)])
    low = np.minimum(np.floor(list(frames)).astype(int), plan.motion.frames - 1)
    high = np.minimum(low + 1, plan.motion.frames - 1)
    share = (np.array(list(frames)) - low)[:, None]
    chain = Chain.from_angles(MODULES[plan.kind], plan.motion.folded[pad:])
    return chain, ends[low] + share * (ends[high] - ends[low])


def proved_clearance(plan: foldback_check.Plan) -> float:
    """The least clearance that the planner finds at frames and some moments between them."""
    frames = (np.arange(plan.motion.frames - 1)[:, None] + BETWEEN).ravel()
    return float(clearances_of(*sampled(plan, frames), size=plan.size)[0].min())


# ------------------------------------------------------------------ forging


@dataclass(frozen=True)
class Forged:
    """A forged plan and what was done to it."""

    path: Path
    change: str
    seed: int


def angle_of(f: Arrays) -> np.ndarray:
    return f["angles_rad"] if "first" in f else f["joint_angles_rad"]


def some_angles(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    values = angle_of(f).reshape(-1)
    at = rng.integers(0, len(values), rng.integers(1, 40))
    values[at] += rng.normal(0, 10.0 ** rng.uniform(-4, 0), len(at))


def one_hinge(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    if "first" in f:
        return some_angles(f, told, rng)
    q = f["joint_angles_rad"]
    q[1:-1, rng.integers(q.shape[1])] += rng.choice([-1, 1]) * 10.0 ** rng.uniform(-2.5, 0)
    return None


def frames_swapped(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    if "first" in f:
        return windows_moved(f, told, rng)
    q = f["joint_angles_rad"]
    i, j = rng.integers(1, len(q) - 1, 2)
    q[[i, j]] = q[[j, i]]
    return None


def frames_dropped(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    """Frames stay clear, and modules meet between them."""
    if "first" in f:
        return windows_moved(f, told, rng)
    last = len(f["time_s"]) - 1
    kept = np.unique([0, *rng.integers(0, last, rng.integers(0, 12)), last])
    f["joint_angles_rad"], f["time_s"] = f["joint_angles_rad"][kept], f["time_s"][kept]
    return None


def windows_moved(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    if "first" not in f:
        return frames_dropped(f, told, rng)
    name = str(rng.choice(["first", "offsets"]))
    at = rng.integers(0, len(f[name]))
    f[name][at:] += rng.choice([-2, -1, 1, 2])
    return None


def larger(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    told["certificate"]["module_size"] *= rng.uniform(1.0, 1.1)


def claim(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    said = told["certificate"]
    said["clearance_bound"] = float(
        rng.choice([said["clearance_bound"] * rng.uniform(1.0, 30.0), -0.1, 0.0, 1e9])
    )


def exempt(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    pairs = told["certificate"].setdefault("exempt_pairs", {"apart": 0, "count": 0})
    pairs[str(rng.choice(["apart", "count"]))] += int(rng.integers(1, 9))


def names(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    f["joint_names"] = rng.permutation(f["joint_names"])


def folded(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    angles = told["chain"]["folded_rad"]
    angles[rng.integers(len(angles))] += rng.normal(0, 0.5)


def times(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    f["time_s"] = f["time_s"][::-1]


def verdict(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    told["certificate"]["verdict"] = "not verified"


def modules(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    told["chain"]["modules"] += int(rng.choice([-1, 1]))


def another_module(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    """A solid that is smaller than the one that it is called."""
    kind = told["chain"]["module"]
    geometry = json.loads(json.dumps(foldback_check.MODULES[kind]))
    geometry["corners"] = (np.array(geometry["corners"]) * rng.uniform(0.5, 0.99)).tolist()
    told["claim"] = {"module": geometry}


def digest(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    told["claim"] = {"angles_sha256": "0" * 64}


def unreadable(f: Arrays, told: dict[str, Any], rng: Random) -> None:
    del f[str(rng.choice(["joint_names", "time_s"]))]


LIES: Mapping[str, Change] = {
    change.__name__: change
    for change in (
        *(some_angles, one_hinge, frames_swapped, frames_dropped, windows_moved, larger, claim),
        *(exempt, names, folded, times, verdict, modules, another_module, digest, unreadable),
    )
}
NEVER = {"exempt", "names", "times", "verdict", "modules", "another_module", "digest", "unreadable"}
"""Lies that no proof can survive, whatever the numbers are."""


def forge(source: Path, path: Path, seed: int) -> Forged:
    """Write a plan with one lie in it."""
    rng = np.random.default_rng(seed)
    change = list(LIES)[seed % len(LIES)]
    with np.load(source) as file:
        f = {name: file[name] for name in file.files}
    told = json.loads(str(f["plan"]))
    plan = foldback_check.Plan(source)
    if "first" in f:
        f.pop("angle_planes", None)
        f["angles_rad"] = plan.motion.values.copy()
    told.get("claim", {}).pop("angles_sha256", None)  # who forges a plan works it out anew
    LIES[change](f, told, rng)
    f["plan"] = np.array(json.dumps(told))
    np.savez_compressed(path, **f)
    return Forged(path, change, seed)


def test_no_forged_plan_is_proved(plans: list[Path], tmp_path: Path) -> None:
    forged = [
        forge(plans[seed % len(plans)], tmp_path / f"{seed}.npz", SEED * 1000 + seed)
        for seed in range(FORGED)
    ]
    refused = 0
    for told, found in zip(forged, verdicts([each.path for each in forged]), strict=True):
        other = python_says(told.path)["verdict"] == "proved"
        assert found["proved"] == other, (told, found)
        refused += not found["proved"]
        if not found["proved"]:
            continue
        assert told.change not in NEVER, told
        plan = foldback_check.Plan(told.path)
        assert proved_clearance(plan) >= found["claim"] - 1e-6, (told, found)
    assert refused >= FORGED / 2


@pytest.mark.parametrize("change", [{"apart": 9}, {"apart": 0}, {"rigid_links": -1}])
def test_a_module_of_ones_own_exempts_no_more(change: dict[str, Any], tmp_path: Path) -> None:
    with np.load(PLANS["box-8-windows"]) as file:
        f = {name: file[name] for name in file.files}
    told = json.loads(str(f["plan"]))
    geometry = json.loads(json.dumps(foldback_check.MODULES["cube"])) | change
    told["chain"]["module"], told["claim"] = "brick", {"module": geometry}
    apart = geometry["apart"]
    told["certificate"]["exempt_pairs"] = {"apart": apart, "count": (apart - 1) * 7}
    f["plan"] = np.array(json.dumps(told))
    np.savez(tmp_path / "own.npz", **f)
    (found,) = verdicts([tmp_path / "own.npz"])
    assert not found["proved"]


def test_no_bound_is_above_what_is_seen(tmp_path: Path) -> None:
    """With few frames hinges turn far from one to the next, and interpolation loses much."""
    paths: list[Path] = []
    for stride in (2, 3, 5, 8, 12):
        with np.load(PLANS["ring-12-frames"]) as file:
            f = {name: file[name] for name in file.files}
        q = foldback_check.Plan(PLANS["ring-12-frames"]).motion.values.reshape(len(f["time_s"]), -1)
        kept = np.unique([*range(0, len(q), stride), len(q) - 1])
        f["joint_angles_rad"], f["time_s"] = q[kept], f["time_s"][kept]
        told = json.loads(str(f["plan"]))
        told["certificate"] |= {"clearance_bound": 1e-3, "frames": None, "max_joint_step_rad": None}
        told.pop("claim", None)
        f["plan"] = np.array(json.dumps(told))
        paths.append(tmp_path / f"{stride}.npz")
        np.savez(paths[-1], **f)
    for path, found in zip(paths, verdicts(paths), strict=True):
        assert found["proved"] == (python_says(path)["verdict"] == "proved")
        if found["proved"]:
            assert found["bounds"] > 100
            assert found["above"] == 0
            assert found["least"] <= proved_clearance(foldback_check.Plan(path)) + 1e-6
