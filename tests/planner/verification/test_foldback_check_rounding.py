"""Rounding in the independent checker: its bounds, compared with 80-bit arithmetic."""

from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
import pytest

from foldback import foldback_check
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.clearance.rounding_errors import clearance_rounding
from foldback.planner.parameters.parameters import Parameters
from tests.planner.chains import unvalidated
from tests.planner.peels import peel, snake, windows_of
from tests.planner.plans import unverified
from tests.planner.verification.forged_plans import rewrite
from tests.web.node import JavaScriptChecker

U: Final = foldback_check.U
CHAINS: Final = {
    "cubes": snake((6, 6, 16)),
    "tetrahedra": unvalidated(TETRAHEDRON, np.resize([0.7, -1.2, 0.3, 1.1], 599)),
}


class Unproved(foldback_check.Proof):
    """A proof that checks no interval, for its bounds and poses."""

    def _halves(self, items: list[Any]) -> list[Any]:
        return []


@pytest.fixture(params=CHAINS)
def plan(request: pytest.FixtureRequest, tmp_path: FilePath) -> FilePath:
    """Return the file of a plan that folds a chain window by window; nothing was checked."""
    chain, path = CHAINS[request.param], tmp_path / "plan.npz"
    motion = peel(chain, width=24, step=1.5)
    ends = list(zip(motion.offsets[:-1], motion.offsets[1:], strict=True))
    angles = [motion.angles_rad[a:b].astype(float) for a, b in reversed(ends)]
    windows = windows_of(chain, motion.first[::-1].tolist(), angles)
    unverified(chain, windows, Parameters()).save_npz(path)

    def verified(_: dict[str, Any], meta: Any) -> None:
        meta["certificate"] |= {"verified": True, "reason": None, "clearance_bound": 1e-4}

    rewrite(path, path, verified)
    return path


def exact_poses(module: foldback_check.Module, angles: Any) -> tuple[Any, Any]:
    """Return (n, 3) centres and (n, 3, 3) rotations in 80-bit arithmetic.

    Args:
        module: The checker's module.
        angles: Angles of all slots, rad.
    """
    description = module.description
    turns, anchor, offset = (
        np.array(description[part][0], np.longdouble) for part in ("turns", "anchor", "offset")
    )
    centres: list[Any] = [np.zeros(3, np.longdouble)]
    rotations: list[Any] = [np.eye(3, dtype=np.longdouble)]
    for row in np.array(angles, np.longdouble).reshape(-1, len(module.names)):
        rotation = rotations[-1]
        for k, turn in enumerate(turns):
            rotation = rotation @ turn
            if k < len(row):
                c, s = np.cos(row[k]), np.sin(row[k])
                rotation = rotation @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], np.longdouble)
        centres.append(centres[-1] + rotations[-1] @ anchor + rotation @ offset)
        rotations.append(rotation)
    return np.array(centres), np.array(rotations)


def test_rounding_bound_covers_what_double_precision_loses() -> None:
    random = np.random.default_rng(3)
    for description in (foldback_check.CUBE, foldback_check.TETRAHEDRON):
        geometry = foldback_check.geometry(description, foldback_check.FORMATS[0])
        module = foldback_check.Module(geometry, 0.95)
        count = 100
        q = random.uniform(-1.5, 1.5, (count - 1) * len(module.names))
        poses = module.chain(q)
        centres, rotations = exact_poses(module, q)
        worst = max(
            float(np.abs(poses[:, 0] - centres).max()),
            float(np.abs(poses[:, 1:].swapaxes(1, 2) - rotations).max()),
        )
        assert 0.0 < worst < count * count * 30 * U


def test_distances_in_windows_are_off_by_less_than_the_bound(plan: FilePath) -> None:
    checked = foldback_check.Plan(plan)
    proof, module, n = Unproved(checked), checked.module, checked.count
    assert proof.rounding < 0.5 * proof.chain_rounding
    part = module.pieces[0][0]
    random, none = np.random.default_rng(2), np.zeros(4000, int)
    for frame in (checked.frames // 4, checked.frames // 2):
        batch = foldback_check.Batch(proof, [(frame, 0.0, 1.0, None)])
        before, after = (checked.angles(k, 0, len(checked.folded)) for k in (frame, frame + 1))
        share = np.longdouble(foldback_check.NODES[1])
        angles = np.longdouble(before) + share * (np.longdouble(after) - np.longdouble(before))
        centres, rotations = exact_poses(module, angles)
        corners = centres[:, None] + np.longdouble(part.corners) @ rotations.swapaxes(1, 2)
        i, j = np.sort(random.integers(0, n, (2, len(none))), axis=0)
        assert (i < checked.low[frame]).any() and (j > checked.high[frame]).any()
        pose = foldback_check.relative(batch.poses(i, none), batch.poses(j, none))[:, 1]
        a, b = random.integers(0, len(part.corners), (2, len(none)))
        gap = np.einsum("qx,qxy->qy", part.solid[b], pose) - part.corners[a]
        exact = np.sqrt(((corners[j, b] - corners[i, a]) ** 2).sum(1))
        off = np.abs(np.linalg.norm(gap, axis=1) - exact).max()
        assert 0.0 < off < proof.rounding / np.abs(foldback_check.BERNSTEIN).sum(1).max()


def test_folded_modules_have_orthonormal_axes(plan: FilePath) -> None:
    proof = Unproved(foldback_check.Plan(plan))
    axes = proof.folded[:, 1:, 1:]
    assert np.linalg.norm(axes @ axes.swapaxes(1, 2) - np.eye(3), axis=(1, 2)).max() < 32 * U


def test_batch_spans_at_most_twice_the_widest_window(
    plan: FilePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foldback_check, "MODULES_AT_ONCE", 10**6)
    spans: list[int] = []

    class Batches(foldback_check.Proof):
        def _halves(self, items: list[Any]) -> list[Any]:
            spans.append(foldback_check.Batch(self, items).m)
            return []

    checked = foldback_check.Plan(plan)
    Batches(checked)
    assert len(spans) > 1
    assert max(spans) <= 2 * checked.widest + 1


def test_all_programs_take_off_nearly_the_same(plan: FilePath) -> None:
    checked = foldback_check.Plan(plan)
    proof = Unproved(checked)
    chain = CHAINS["cubes" if checked.kind == "cube" else "tetrahedra"]
    firsts = (checked.first - checked.pad).tolist()
    parts = np.split(checked.values, checked.offsets[1:-1])
    stated = clearance_rounding(chain, windows_of(chain, firsts, parts), checked.size)
    # A certificate states no more than the checkers prove.
    assert proof.rounding <= stated <= 1.5 * proof.rounding
    with JavaScriptChecker("rounding") as checker:
        assert checker(plan)["rounding"] == pytest.approx(proof.rounding, rel=1e-6)
