"""Motion of plans by ipctk: verified folds are clear, and contacts between frames are found."""

import os
import sys
from pathlib import Path

import ipctk
import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2]))

from foldback import foldback_check
from foldback.planner.verification.third_opinion import ask_ipctk
from tests.planner.verification.forged_plans import save

FOLDED = ("short", "wrench-24", "ring", "mallet-64", "refold")


@pytest.mark.parametrize("name", FOLDED)
def test_verified_folds_are_clear(name: str) -> None:
    path = Path(os.environ["FOREIGN_PLANS"]) / name / "plan.npz"
    plan = foldback_check.Plan(path)
    opinion = ask_ipctk(plan)
    assert opinion.contacts == ()
    assert opinion.parts >= opinion.intervals == plan.frames - 1
    assert 0.85 * plan.claim < opinion.clearance < plan.claim


def test_contact_between_two_frames_only_is_found(tmp_path: Path) -> None:
    # 0.2, 0.04 and 0.03 of a pitch apart at the frames; modules 5 and 7 overlap by 0.1 at 1.33.
    turned = [
        [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0],
        [-10, -79, 0, 26, 37, -5, -4, 17, 25, -3, -40, 87, -56, 54],
        [-52, -92, -46, 26, 15, -75, 29, 26, 69, -48, -85, 86, -51, 54],
    ]
    opinion = ask_ipctk(foldback_check.Plan(save(tmp_path / "plan.npz", np.radians(turned))))
    [contact] = opinion.contacts
    assert contact.modules == (5, 7)
    assert 1.0 < contact.frame < 4 / 3


def test_true_result_means_no_contact() -> None:
    first = np.asfortranarray([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    faces, edges = np.array([[1, 2, 3]], "i4"), np.array([[1, 2], [2, 3], [1, 3]], "i4")
    mesh = ipctk.CollisionMesh(first, edges, faces)
    near, through = first.copy(order="F"), first.copy(order="F")
    near[0, 2], through[0, 2] = 0.1, -0.1
    assert ipctk.is_step_collision_free(mesh, first, near)
    assert not ipctk.is_step_collision_free(mesh, first, through)
