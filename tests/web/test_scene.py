"""Scenes of folds and of previews: in a viser server, and as a browser gets them.

``test_show.py`` compares poses.
"""

import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser
from viser import _messages as messages

from foldback.planner.chain.built_in_modules import TETRAHEDRON, module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.web.palette import MAX_ERROR_RGB, NO_ERROR_RGB, UNKNOWN_ERROR_RGB
from foldback.web.pictures.camera import framing
from foldback.web.static_files import STATIC
from foldback.web.timeline.view import TimelineView
from foldback.web.viser.preview_scene import SCENE_SIZE, preview_scene_of
from foldback.web.viser.recording import look
from foldback.web.viser.scene import Scene
from foldback.web.viser.scene_bundle import bundle_of, viser_scene
from tests.web.timeline.decoding import decode


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def messages_of(server: viser.ViserServer, kind: type) -> list[messages.Message]:
    """Return the messages that a new client would be sent."""
    buffer = server._websock_server.get_message_buffer()
    return [m for m in buffer.message_from_id.values() if isinstance(m, kind)]


def test_scene_marks_both_ends_above_the_ground_and_moves_all_cameras(
    server: viser.ViserServer, timeline_path: Path, chain: Chain
) -> None:
    scene = Scene(server, chain)
    straight = TimelineView(timeline_path).snapshot(99)
    scene.show(straight, np.tile(np.array(UNKNOWN_ERROR_RGB, np.uint8), (len(chain), 1)))
    ends = np.asarray(scene._ends.batched_positions) / scene.pitch
    way = straight.positions[1] - straight.positions[0]
    assert (ends[0] - straight.positions[0]) @ way == pytest.approx(-0.465, abs=1e-3)
    assert (ends[1] - straight.positions[-1]) @ way == pytest.approx(0.465, abs=1e-3)
    out = matrix_from_wxyz(np.asarray(scene._ends.batched_wxyzs, np.float64))[:, :, 0] @ way
    assert out == pytest.approx([-1.0, 1.0], abs=1e-3)

    while scene.move_ground(0.1):
        pass
    assert scene._floor.position[2] < (straight.positions[:, 2].min() - 0.5) * scene.pitch

    view = framing(scene.points(straight), radius=scene.radius)
    look(server, view)
    (position,) = messages_of(server, messages.SetCameraPositionMessage)
    (target,) = messages_of(server, messages.SetCameraLookAtMessage)
    assert np.allclose(position.position, view.position)
    assert np.allclose(target.look_at, view.target)
    assert not position.initial


def refusals(header: dict[str, Any]) -> set[str]:
    """Return types of a scene's messages that the view does not pass to viser's client."""
    bridge = (STATIC / "js/viewer/bridge.js").read_text(encoding="utf-8")
    matches = set(re.findall(r'"(\w+Message)"', bridge.partition("SHOWN")[2].partition("]")[0]))
    # None of them contains text that could be a script; the links of a theme are removed.
    assert not [name for name in matches if re.search("Gui|Notification|Html|Label", name)]
    return {message["type"] for message in header["messages"]} - matches


def test_bundle_has_the_nodes_properties_and_chain_that_pages_use(chain: Chain) -> None:
    header, arrays = decode(bundle_of(chain))
    kinds = {m["type"] for m in header["messages"]}
    # The page's updates for each frame use the names of these nodes and properties.
    assert {"BatchedMeshesMessage", "GridMessage", "LineSegmentsMessage"} <= kinds
    nodes = {m["name"]: m for m in header["messages"] if "props" in m}
    assert {"/modules", "/ends", "/path", "/ground"} <= nodes.keys()
    props = nodes["/modules"]["props"]
    for name in ("batched_positions", "batched_wxyzs", "batched_colors"):
        assert props[name]["column"] in arrays
    assert {"opacity", "cast_shadow", "receive_shadow"} <= props.keys()
    assert "points" in nodes["/path"]["props"]
    assert refusals(header) == set()
    stated = header["chain"]
    assert stated["modules"] == 16
    assert stated["hinge_names"] == list(chain.module.hinge_names)
    assert np.allclose(arrays["folded_rad"], chain.folded_rad)
    assert np.allclose(arrays["folded_positions"], chain.folded_poses.positions)


def test_viser_has_the_messages_that_pages_make() -> None:
    for name, fields in {
        "SceneNodeUpdateMessage": {"name", "updates", "owner"},
        "SetPositionMessage": {"name", "position", "owner"},
        "SetSceneNodeVisibilityMessage": {"name", "visible", "owner"},
        "RemoveSceneNodeMessage": {"name", "owner"},
        "SetCameraPositionMessage": {"position", "initial"},
        "SetCameraLookAtMessage": {"look_at", "initial"},
        "ViewerCameraMessage": {"position", "look_at"},
    }.items():
        assert fields <= set(getattr(messages, name).__dataclass_fields__), name


def test_chains_of_one_kind_and_length_differ_only_in_shape() -> None:
    first_scene, two = (
        Chain.from_angles(TETRAHEDRON, np.deg2rad(angles), name=name)
        for angles, name in (([90.0, 90.0], "a"), ([-90.0, 90.0], "b"))
    )
    first, second = decode(bundle_of(first_scene)), decode(bundle_of(two))
    assert first[0]["messages"] == second[0]["messages"]
    assert (first[0]["chain"]["name"], second[0]["chain"]["name"]) == ("a", "b")
    assert not np.allclose(first[1]["folded_rad"], second[1]["folded_rad"])


def test_scenes_do_not_wait_for_each_other_and_leave_no_server(chain: Chain) -> None:
    before = threading.active_count()
    with viser_scene(chain):
        other_chain = Chain.from_angles(TETRAHEDRON, np.deg2rad([90.0] * 5), name="d")
        thread = threading.Thread(target=bundle_of, args=(other_chain,), daemon=True)
        thread.start()
        thread.join(20.0)
        assert not thread.is_alive()
    assert threading.active_count() <= before


ROW = [[x, 0, 0] for x in range(4)]


def report(**extra: Any) -> dict[str, Any]:
    cells = dict.fromkeys(("cells", "positions", "line"), ROW)
    return {"module_value": "cube", "has_path": True, "wxyzs": None, "mesh": None, **cells, **extra}


def hull_of(header: dict[str, Any]) -> np.ndarray:
    return np.array(header["hull"]["parts"][0]["vertices"])


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
    visible_names = {m["name"]: m["visible"] for m in header["messages"] if "visible" in m}
    assert (visible_names["/selected"], visible_names["/cells"], visible_names["/path"]) == (
        False,
        True,
        True,
    )
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
    # The picture includes added cells: the row and the cell beyond it fill the size.
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
    stated = report(
        module_value="tetrahedron", positions=places, line=places, wxyzs=poses.wxyzs.tolist()
    )
    stated["cells"] = np.rint(poses.positions).astype(int).tolist()
    header, arrays, nodes = read_bundle(stated)
    turns = arrays[nodes["/cells"]["batched_wxyzs"]["column"]].reshape(-1, 4)
    assert np.allclose(turns, poses.wxyzs, atol=1e-6)
    assert header["hull"]["modules"] == len(places)


def test_path_of_modules_off_the_lattice_leads_from_centre_to_centre() -> None:
    prism = module_named("snake-prism")
    poses = Chain.from_angles(prism, np.deg2rad([90.0, 0.0, -90.0, 0.0, 90.0])).folded_poses
    places = poses.positions.tolist()
    stated = report(
        **{"module_value": prism.document, "cells": np.rint(poses.positions).astype(int).tolist()},
        **{"positions": places, "line": places, "wxyzs": poses.wxyzs.tolist()},
    )
    _, arrays, nodes = read_bundle(stated)
    assert "/path/rods0" not in nodes
    rods = nodes["/path/rods"]
    centres, turns, scales = (
        arrays[rods[f"batched_{name}"]["column"]].reshape(-1, width)
        for name, width in (("positions", 3), ("wxyzs", 4), ("scales", 3))
    )
    beads = arrays[nodes["/path/beads"]["batched_positions"]["column"]].reshape(-1, 3)
    steps = np.diff(beads, axis=0)
    assert np.allclose(centres, beads[:-1] + steps / 2, atol=1e-5)
    along = matrix_from_wxyz(turns.astype(np.float64))[:, :, 0]
    across = np.cross(along, steps)
    assert np.allclose(across, 0.0, atol=1e-5)
    assert np.allclose(np.diff(scales[:, 0] / np.linalg.norm(steps, axis=1)), 0.0, atol=1e-5)
