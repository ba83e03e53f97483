from __future__ import annotations

import numpy as np
import pytest

from planner.chain.module import MODULES
from web.pictures.camera import FIELD_OF_VIEW_RAD
from web.pictures.meshes import DISPLAYED_MODULE_SIZE
from web.pictures.sketch import sketch_outline


@pytest.mark.parametrize("name", sorted(MODULES))
def test_the_drawn_hull_is_closed_and_turns_outwards(name: str) -> None:
    module = MODULES[name]
    outline = sketch_outline(module, 2)
    assert outline["modules"] == 2
    assert outline["field_of_view_rad"] == pytest.approx(FIELD_OF_VIEW_RAD)
    corners = np.array(outline["corners"])
    np.testing.assert_allclose(corners, module.vertices * DISPLAYED_MODULE_SIZE)
    edges: list[tuple[int, int]] = []
    for face, normal in zip(outline["faces"], outline["normals"], strict=True):
        ring = corners[face]
        turning = np.cross(ring[1] - ring[0], ring[2] - ring[1])
        np.testing.assert_allclose(turning / np.linalg.norm(turning), normal, atol=1e-9)
        np.testing.assert_allclose(ring @ normal, (corners @ normal).max(), atol=1e-9)
        edges += zip(face, face[1:] + face[:1], strict=True)
    # Every edge is passed once each way: there is no hole.
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
