"""The table under a chain: large enough, closed, and turned outwards."""

from __future__ import annotations

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.path import Path
from web.pictures.table_top import MIN_TABLE_SIDE_PITCH, TABLE_MARGIN_PITCH, TableTop, disc_mesh

CHAIN = Chain.from_path(Path.from_cells([(x, 0, 0) for x in range(12)] + [(11, 1, 0), (11, 1, 1)]))


def test_it_is_as_high_as_the_lowest_modules_and_larger_than_the_motion() -> None:
    positions = np.array([[[-3.0, 2.0, 0.0], [20.0, 4.0, 1.0]]])
    table = TableTop.under(CHAIN, positions)
    assert table.height == pytest.approx(-0.5)
    assert table.middle == (8.5, 3.0)
    assert table.sides == (23.0 + 1.0 + 2 * TABLE_MARGIN_PITCH, MIN_TABLE_SIDE_PITCH)
    unknown = TableTop.under(CHAIN)
    assert min(unknown.sides) > 2 * len(CHAIN)


def test_its_mesh_is_closed_and_turns_outwards() -> None:
    table = TableTop.under(CHAIN, CHAIN.folded_poses.positions)
    mesh = table.mesh()
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volume = float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)
    full = table.thickness * table.sides[0] * table.sides[1]
    assert 0.85 * full < volume < full
    assert mesh.vertices[:, 2].max() == pytest.approx(table.height)
    assert mesh.vertices[:, 2].min() == pytest.approx(table.height - table.thickness)
    # Every edge stands between two faces.
    corners = np.unique(np.round(mesh.vertices, 6), axis=0, return_inverse=True)[1]
    faces = corners.reshape(-1)[mesh.faces]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_a_disc_faces_up() -> None:
    disc = disc_mesh()
    a, b, c = (disc.vertices[disc.faces[:, k]] for k in range(3))
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
