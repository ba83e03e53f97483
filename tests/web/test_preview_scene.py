from typing import Any

import numpy as np
import pytest

from planner.chain.chain import Chain
from planner.chain.module import TETRAHEDRON
from tests.web.test_scene import refusals
from web.palette import MAX_ERROR_RGB, NO_ERROR_RGB
from web.pictures.camera import framing
from web.timeline.columns import decode
from web.viser.preview_scene import SCENE_SIZE, preview_scene_of

ROW = [[x, 0, 0] for x in range(4)]


def report(**more: Any) -> dict[str, Any]:
    return {
        "module": "cube",
        "cells": ROW,
        "positions": ROW,
        "wxyzs": None,
        "line": ROW,
        "has_path": True,
        "mesh": None,
        **more,
    }


def hull_of(header: dict[str, Any]) -> np.ndarray:
    return np.array(header["hull"]["vertices"])


def read_bundle(stated: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Return header, columns and the properties of the nodes by name."""
    header, arrays = decode(preview_scene_of(stated))
    nodes = {m["name"]: m["props"] for m in header["messages"] if "props" in m}
    return header, arrays, nodes


def test_layers_are_nodes_and_cells_with_a_path_are_transparent() -> None:
    mesh = {"vertices": [[0, 0, 0], [3, 0, 0], [0, 3, 0]], "faces": [[0, 1, 2]]}
    header, arrays, nodes = read_bundle(report(mesh=mesh))
    assert {"/solid", "/cells", "/path", "/selected"} <= nodes.keys()
    assert refusals(header) == set()
    assert nodes["/cells"]["opacity"] == header["colours"]["ghost_opacity"]
    assert arrays["cells"].tolist() == ROW
    assert (arrays["colours"][0] != arrays["colours"][-1]).any()  # from first to last
    shown = {m["name"]: m["visible"] for m in header["messages"] if "visible" in m}
    assert (shown["/selected"], shown["/cells"], shown["/path"]) == (False, True, True)
    _, _, nodes = read_bundle(report(cells=[], positions=None, has_path=False, mesh=mesh))
    assert "/solid" in nodes and "/cells" not in nodes


def test_cells_without_a_path_show_problems_and_additions() -> None:
    state = {
        "problems": [{"cells": [[2, 0, 0]]}],
        "repairs": [{"add": [[4, 0, 0]], "drop": []}],
    }
    stated = report(has_path=False, positions=None, line=None, feasibility=state)
    header, arrays, nodes = read_bundle(stated)
    assert "/path" not in nodes
    assert nodes["/cells"]["opacity"] is None
    assert "/added" in nodes
    # They are in the picture, too: the row and the cell beyond it fill the size.
    corners = np.array(header["corners"])
    assert np.ptp(corners[:, 0]) + np.ptp(hull_of(header)[:, 0]) == pytest.approx(SCENE_SIZE)
    assert arrays["colours"].tolist() == [
        list(c) for c in (NO_ERROR_RGB, NO_ERROR_RGB, MAX_ERROR_RGB, NO_ERROR_RGB)
    ]


def test_scene_size_does_not_depend_on_the_number_of_modules() -> None:
    cells = [[x, 0, 0] for x in range(300)]
    header, arrays, nodes = read_bundle(report(cells=cells, positions=cells, line=cells))
    at = arrays[nodes["/cells"]["batched_positions"]["column"]].reshape(-1, 3)
    hull = hull_of(header)
    assert np.ptp(at[:, 0]) + np.ptp(hull[:, 0]) == pytest.approx(SCENE_SIZE, rel=1e-5)
    assert np.ptp(np.array(header["corners"])[:, 0]) == pytest.approx(np.ptp(at[:, 0]), rel=1e-5)
    stated = {name: header["camera"][name] for name in ("azimuth_rad", "elevation_rad", "margin")}
    view = framing(np.array(header["corners"]), radius=header["radius"], **stated)
    assert view.distance > SCENE_SIZE


def test_tetrahedra_have_their_folded_poses() -> None:
    poses = Chain.from_angles(TETRAHEDRON, np.deg2rad([90.0, -90.0]), name="a").folded_poses
    places = poses.positions.tolist()
    stated = report(module="tetrahedron", positions=places, line=places, wxyzs=poses.wxyzs.tolist())
    stated["cells"] = np.rint(poses.positions).astype(int).tolist()
    header, arrays, nodes = read_bundle(stated)
    turns = arrays[nodes["/cells"]["batched_wxyzs"]["column"]].reshape(-1, 4)
    assert np.allclose(turns, poses.wxyzs, atol=1e-6)
    assert header["hull"]["modules"] == len(places)
