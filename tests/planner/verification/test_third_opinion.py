"""Plans as linear motions of triangles: mesh, exempt pairs, subdivision; missing ipctk."""

import sys
from pathlib import Path as FilePath

import numpy as np
import pytest

from foldback import foldback_check
from foldback.planner.errors import InputError
from foldback.planner.verification.third_opinion import (
    Vertices,
    largest_deviation,
    mesh_of,
    toolkit,
)
from foldback.planner.verification.verify import verify
from tests.planner.conftest import Folded
from tests.refusal import refused


def test_mesh_holds_all_modules_and_exempts_own_and_linked_vertices() -> None:
    corners = np.array(foldback_check.CUBE["corners"])
    mesh = mesh_of([[corners]] * 3, 2)
    assert mesh.faces.shape == (36, 3)
    assert mesh.edges.shape == (54, 2)
    assert set(mesh.faces[12:24].ravel().tolist()) == set(range(8, 16))
    exempt = {tuple(pair) for pair in mesh.exempt.tolist()}
    expected = {(a, b) for a in range(24) for b in range(a + 1, 24) if b // 8 - a // 8 < 2}
    assert exempt == expected
    alone = mesh_of([[np.array(foldback_check.TETRAHEDRON["corners"])]] * 3, 1)
    assert alone.faces.shape == (12, 3)
    assert len(alone.exempt) == 18, "linked tetrahedra are not exempt"
    two = mesh_of([[corners], [corners, corners + 2.0]], 1)
    assert len(two.faces) == 36
    assert set(two.faces[24:].ravel().tolist()) == set(range(16, 24))
    assert len(two.exempt) == 28 + 120, "parts of a module may touch each other"


def test_parts_are_straight_within_the_tolerance_at_all_moments(folded: Folded) -> None:
    plan = foldback_check.Plan(folded.directory / "plan.npz")
    vertices, frame, tolerance = Vertices(plan), plan.frames - 20, 1e-4
    division = vertices.divide(frame, tolerance)
    parts, fine = len(division.vertices) - 1, 16
    first, last = (plan.angles(k, 0, len(plan.folded)) for k in (frame, frame + 1))
    path_vertices = vertices.at(first, last, parts * fine)
    share = np.arange(fine)[:, None, None] / fine
    steps = np.diff(division.vertices, axis=0)[:, None]
    straight = division.vertices[:-1, None] + share * steps
    off = np.linalg.norm(path_vertices[:-1].reshape(straight.shape) - straight, axis=-1).max()
    assert parts > 1
    assert 0.1 * tolerance < off <= division.deviation <= tolerance
    assert largest_deviation(division.vertices[[0, 0, 0, 0, 0]]) == 0.0


def test_vertices_are_those_of_the_chain_seen_from_the_middle_module(folded: Folded) -> None:
    plan = foldback_check.Plan(folded.directory / "plan.npz")
    angles = plan.angles(plan.frames - 1, 0, len(plan.folded))
    frame_vertices = Vertices(plan).at(angles, angles, 1)[0].reshape(24, 8, 3)
    module = np.sort(frame_vertices[12], axis=0)
    np.testing.assert_allclose(
        module, np.sort(plan.module.pieces[0][0].corners, axis=0), atol=1e-12
    )
    sides = np.linalg.norm(frame_vertices[:, :, None] - frame_vertices[:, None], axis=-1)
    np.testing.assert_allclose(sides, np.broadcast_to(sides[12], sides.shape), atol=1e-12)
    centres = frame_vertices.mean(axis=1)
    gaps = np.abs(centres[:, None] - centres).max(axis=2)
    np.testing.assert_allclose(gaps, gaps.round(), atol=1e-6)
    assert (np.abs(frame_vertices - centres[:, None]).max(axis=1) < plan.size / 2 + 1e-6).all()


def test_missing_program_is_reported_before_any_check(
    monkeypatch: pytest.MonkeyPatch, tmp_path: FilePath
) -> None:
    monkeypatch.setitem(sys.modules, "ipctk", None)
    with refused("no-ipctk", match=r"pip install 'foldback\[ipctk\]'"):
        verify(tmp_path, third_opinion=True)
    with pytest.raises(InputError):
        toolkit()
