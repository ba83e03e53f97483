"""Exports: third-party programs read them with the plan's poses."""

import csv
import dataclasses
import io
import json
import re
import struct
import sys
from contextlib import nullcontext
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pygltflib
import pytest
import trimesh
import yaml
import yourdfpy
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation, Slerp

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses
from foldback.planner.chain.polyhedron import volume_moments
from foldback.planner.errors import InputError
from foldback.planner.exports import glb
from foldback.planner.exports.export import Export
from foldback.planner.exports.formats import EXPORTS, export_named, exports_of
from foldback.planner.exports.mjcf import KEY_PERCENTS
from foldback.planner.exports.urdf import DRAKE_NAMESPACE, centre_of
from foldback.planner.pipeline.fold import fold
from foldback.planner.plan.plan import Plan
from foldback.planner.readers.angle_strings import read_angle_string
from tests.planner.brackets import BRACKETS
from tests.planner.chains import Array

PLAIN_EXPORTS = [export for export in EXPORTS if not export.coded]
"""Exports of plans of cubes and tetrahedra."""
HOSTILE_NAME = "</robot>\x00\x1b[31m\ud800\u202e\uffff \"'&<]]>\n- -- \U0001f980"


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    chain = read_angle_string("- - - + - - - + - - -", name="ring")
    return fold(chain, directory=tmp_path_factory.mktemp("ring"))


@pytest.fixture(scope="module")
def bent(tmp_path_factory: pytest.TempPathFactory) -> Plan:
    chain = Chain.from_angles(BRACKETS, np.deg2rad([40.0, 0.0, -40.0, 0.0, 50.0]), name="bent")
    return fold(chain, directory=tmp_path_factory.mktemp("bent"))


@pytest.fixture(params=["folded", "ring", "bent"], ids=["cube", "tetrahedron", "brackets"])
def plan(request: pytest.FixtureRequest) -> Plan:
    """Small plan of each kind of module; its pitch is not 1 cm, so that wrong units are found."""
    export_case = request.getfixturevalue(request.param)
    export_case = export_case.plan if request.param == "folded" else export_case
    return dataclasses.replace(
        export_case, chain=dataclasses.replace(export_case.chain, pitch_m=0.025)
    )


def poses_of(plan: Plan, frame: int) -> Poses:
    return plan.chain.poses(
        plan.joint_angles_rad[frame], plan.root_position[frame], plan.root_wxyz[frame]
    )


def exported(name: str, plan: Plan) -> bytes:
    return export_named(name).write(plan)


def some_frames(plan: Plan) -> list[int]:
    return np.linspace(0, len(plan.time_s) - 1, 7).round().astype(int).tolist()


def same_poses(exported_poses: list[Array], plan: Plan, frame: int, within: float) -> None:
    """Compare (4, 4) transforms in metres, module by module, with the planner's kinematics."""
    poses = poses_of(plan, frame)
    metres = np.array([transform[:3, 3] for transform in exported_poses])
    np.testing.assert_allclose(metres / plan.chain.pitch_m, poses.positions, atol=within)
    turns = np.array([transform[:3, :3] for transform in exported_poses])
    np.testing.assert_allclose(turns, poses.rotations, atol=within)


def transform_of(rotation: ArrayLike, position: ArrayLike) -> Array:
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, position
    return transform


def root_of(plan: Plan, frame: int) -> Array:
    rotation = poses_of(plan, frame).rotations[plan.chain.root]
    return transform_of(rotation, plan.root_position[frame] * plan.chain.pitch_m)


def test_csv_has_every_number_of_the_plan(plan: Plan) -> None:
    data = exported("csv", plan)
    rows = list(csv.reader(io.StringIO(data.decode())))
    names = [f"{name}_rad" for name in plan.chain.joint_names]
    assert {len(row) for row in rows} == {len(names) + 10}
    table = np.genfromtxt(io.BytesIO(data), delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert set(table["phase"]) == {"playback"}
    metres = plan.root_position * plan.chain.pitch_m
    for columns, values in (
        (["time_s"], plan.time_s[:, None]),
        (names, plan.joint_angles_rad),
        (["root_x_m", "root_y_m", "root_z_m"], metres),
        (["root_qw", "root_qx", "root_qy", "root_qz"], plan.root_wxyz),
        (["max_error_rad"], plan.max_error_rad[:, None]),
    ):
        table_angles = np.stack([table[column] for column in columns], axis=1)
        np.testing.assert_allclose(table_angles, values, rtol=0, atol=1e-12)
    unmeasured = dataclasses.replace(plan, max_error_rad=np.full_like(plan.time_s, np.nan))
    first = next(csv.DictReader(io.StringIO(exported("csv", unmeasured).decode())))
    assert first["max_error_rad"] == ""


def test_mjcf_keys_are_frames_of_the_plan(plan: Plan) -> None:
    model = mujoco.MjModel.from_xml_string(exported("mjcf", plan).decode())
    data = mujoco.MjData(model)
    chain, folded = plan.chain, plan.chain.folded_poses
    assert {model.joint(i).name for i in range(model.njnt)} == {"root", *chain.joint_names}
    middle, wxyz = folded.positions.mean(axis=0), folded.wxyzs[chain.root]
    expected = {"straight": chain.poses(np.zeros_like(chain.folded_rad), middle, wxyz)}
    expected["folded"] = folded
    names = [model.key(k).name for k in range(model.nkey)]
    assert names == [*expected, *(f"at_{percent}" for percent in KEY_PERCENTS)]
    ends = {"at_0": 0, "at_100": len(plan.time_s) - 1}
    for name in names:
        mujoco.mj_resetDataKeyframe(model, data, model.key(name).id)
        mujoco.mj_forward(model, data)
        if name not in expected:
            frame = int(np.abs(plan.time_s - data.time).argmin())
            assert plan.time_s[frame] == data.time
            assert ends.get(name, frame) == frame
        poses = expected[name] if name in expected else poses_of(plan, frame)
        sites = [data.site(f"module_{i}") for i in range(len(chain))]
        np.testing.assert_allclose([site.xpos for site in sites], poses.positions, atol=1e-9)
        turns = [site.xmat.reshape(3, 3) for site in sites]
        np.testing.assert_allclose(turns, poses.rotations, atol=1e-9)
        assert data.ncon == 0
    # Drake would confuse body names that differ by an appended digit with names of joints.
    bodies = {model.body(k).name for k in range(model.nbody)}
    assert not bodies & {f"{name}{k}" for name in bodies for k in range(10)}


def mesh_files(plan: Plan) -> dict[str, bytes]:
    """Return the files that a URDF names: each object of the module's mesh is one."""
    head, *objects = exported("obj", plan).decode().split("\no ")
    files: dict[str, bytes] = {}
    count = 0
    for text in objects:
        name, *lines = text.splitlines()
        moved = [
            f"f {' '.join(str(int(k) - count) for k in line.split()[1:])}"
            if line[0] == "f"
            else line
            for line in lines
        ]
        count += sum(line.startswith("v ") for line in lines)
        files[f"{name}.obj"] = "\n".join([head, f"o {name}", *moved, ""]).encode()
    return files


def module_transforms(plan: Plan, links: list[Array]) -> list[Array]:
    """Return the transforms of modules' centres from those of their links."""
    return [
        link @ transform_of(np.eye(3), centre_of(plan.chain, i)) for i, link in enumerate(links)
    ]


def test_urdf_moves_as_the_plan_in_yourdfpy(plan: Plan, tmp_path: Path) -> None:
    (tmp_path / "model.urdf").write_bytes(exported("urdf", plan))
    for name, mesh in mesh_files(plan).items():
        (tmp_path / name).write_bytes(mesh)
    robot: Any = yourdfpy.URDF.load(str(tmp_path / "model.urdf"), build_scene_graph=True)
    assert robot.base_link == f"module_{plan.chain.root}"
    assert tuple(robot.actuated_joint_names) == plan.chain.joint_names
    assert robot.validate()
    for frame in some_frames(plan):
        robot.update_cfg(plan.joint_angles_rad[frame])
        links = [
            root_of(plan, frame) @ robot.get_transform(f"module_{i}")
            for i in range(len(plan.chain))
        ]
        same_poses(module_transforms(plan, links), plan, frame, 1e-6)
    edge = plan.certificate.module_size * plan.chain.pitch_m
    expected: list[float] = []
    for piece in (plan.chain.module.piece(i) for i in range(len(plan.chain))):
        if any(part.box is None for part in piece.parts):
            expected.append(piece.volume)
        else:
            expected += [volume_moments((part,)).volume for part in piece.parts]
    volumes = [geometry.volume / edge**3 for geometry in robot.scene.geometry.values()]
    assert sorted(volumes) == pytest.approx(sorted(expected), rel=1e-6)


def test_urdf_links_have_the_mass_and_inertia_of_solid_modules(plan: Plan) -> None:
    chain = plan.chain
    hulls: list[Any] = []
    for piece in chain.module.pieces:
        parts = [trimesh.convex.convex_hull(p.corners * chain.pitch_m) for p in piece.parts]
        hulls.append(trimesh.util.concatenate(parts))
        hulls[-1].density = plan.parameters["density_kg_m3"]
    urdf = ElementTree.fromstring(exported("urdf", plan))
    masses = []
    for link in urdf.iter("link"):
        inertia, mass = link.find("inertial/inertia"), link.find("inertial/mass")
        assert inertia is not None and mass is not None
        masses.append(float(mass.attrib["value"]))
        moments = [float(inertia.attrib[name]) for name in ("ixx", "iyy", "izz")]
        _, _, index = link.attrib["name"].partition("module_")
        hull = hulls[chain.module.pattern[int(index or 0) % len(hulls)]]
        expected = masses[-1] / hull.mass * np.diag(hull.moment_inertia)
        np.testing.assert_allclose(moments, expected)
    assert sum(masses) == pytest.approx(sum(hulls[i % len(hulls)].mass for i in range(len(chain))))
    limits = [float(e.attrib["upper"]) for e in urdf.iter("limit")]
    np.testing.assert_allclose(limits, [chain.module.largest_angle_rad] * len(chain.joint_names))


def test_urdf_of_small_modules_loads_in_mujoco(plan: Plan) -> None:
    chain = dataclasses.replace(plan.chain, pitch_m=0.001)
    small = dataclasses.replace(plan, chain=chain)
    model = mujoco.MjModel.from_xml_string(exported("urdf", small).decode(), mesh_files(small))
    assert model.nbody > len(plan.chain)


def test_srdf_and_drake_groups_name_the_exempt_pairs(plan: Plan) -> None:
    srdf = ElementTree.fromstring(exported("srdf", plan))
    urdf = ElementTree.fromstring(exported("urdf", plan))
    assert srdf.get("name") == urdf.get("name")
    links = {link.get("name") for link in urdf.iter("link")}
    disabled = {(e.get("link1"), e.get("link2")) for e in srdf.iter("disable_collisions")}
    exempt = plan.chain.module.exempt_pairs(len(plan.chain))
    assert disabled == {(f"module_{i}", f"module_{j}") for i, j in exempt}
    assert {name for pair in disabled for name in pair} <= links
    groups = urdf.findall(f"{{{DRAKE_NAMESPACE}}}collision_filter_group")
    members = set()
    for group in groups:
        assert {e.get("name") for e in group} == {None, group.get("name")}
        members.add(tuple(e.get("link") for e in group if e.get("link")))
    assert members == disabled
    assert tuple(e.get("name") for e in srdf.findall("group/joint")) == plan.chain.joint_names


def test_times_of_exports_rise_where_the_plan_stands_still(plan: Plan) -> None:
    count = len(plan.time_s)
    frames = np.repeat(np.arange(count), [3 if k in (0, 7, count - 1) else 1 for k in range(count)])
    halting = dataclasses.replace(
        plan, motion=plan.motion[frames], max_error_rad=plan.max_error_rad[frames]
    )
    for name in ("csv", "glb"):
        assert exported(name, halting) == exported(name, plan)
    stamps: dict[str, list[int]] = {}
    for channel, record, message in decode_log(exported("mcap", halting)):
        if channel.topic in ("/joint_states", "/tf"):
            header = getattr(message, "header", None) or message.transforms[0].header
            stamp = header.stamp.sec * 10**9 + header.stamp.nanosec
            assert stamp == record.log_time == record.publish_time
            stamps.setdefault(channel.topic, []).append(stamp)
        elif channel.topic == "/joint_trajectory":
            starts = [p.time_from_start for p in message.points]
            stamps[channel.topic] = [s.sec * 10**9 + s.nanosec for s in starts]
    for values in stamps.values():
        assert len(values) == count
        assert (np.diff(values) > 0).all()


def decode_log(data: bytes) -> list[tuple[Any, Any, Any]]:
    """Return channel, record and decoded message of each entry of a log."""
    reader = make_reader(io.BytesIO(data), decoder_factories=[DecoderFactory()])
    return [message[1:] for message in reader.iter_decoded_messages()]


def test_mcap_holds_the_fold_as_ros_messages(plan: Plan) -> None:
    data = exported("mcap", plan)
    chain = plan.chain
    messages: dict[str, list[Any]] = {}
    times: dict[str, list[int]] = {}
    for channel, record, message in decode_log(data):
        messages.setdefault(channel.topic, []).append(message)
        times.setdefault(channel.topic, []).append(record.log_time)
        (profile,) = yaml.safe_load(channel.metadata["offered_qos_profiles"])
        latched = channel.topic == "/robot_description"
        assert (profile["reliability"], profile["durability"]) == (1, 1 if latched else 2)
    states = messages["/joint_states"]
    assert len(states) == len(plan.time_s) == len(messages["/tf"])
    np.testing.assert_allclose(np.array(times["/joint_states"]) * 1e-9, plan.time_s, atol=1e-9)
    for k, state in enumerate(states):
        assert tuple(state.name) == chain.joint_names
        assert (list(state.velocity), list(state.effort)) == ([], [])
        np.testing.assert_array_equal(state.position, plan.joint_angles_rad[k])
    (trajectory,) = messages["/joint_trajectory"]
    assert tuple(trajectory.joint_names) == chain.joint_names
    assert len(trajectory.points) == len(plan.time_s)
    for k, point in enumerate(trajectory.points):
        np.testing.assert_array_equal(point.positions, plan.joint_angles_rad[k])
        since = point.time_from_start.sec + point.time_from_start.nanosec * 1e-9
        assert since == pytest.approx(plan.time_s[k] - plan.time_s[0], abs=2e-9)
    for k in some_frames(plan):
        (transform,) = messages["/tf"][k].transforms
        assert transform.header.frame_id == "world"
        assert transform.child_frame_id == f"module_{chain.root}"
        place, turn = transform.transform.translation, transform.transform.rotation
        rotation = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
        link = transform_of(rotation, [place.x, place.y, place.z])
        np.testing.assert_allclose(link, root_of(plan, k), atol=1e-12)
    if all(part.box is not None for piece in chain.module.pieces for part in piece.parts):
        (description,) = messages["/robot_description"]
        assert description.data.encode() == exported("urdf", plan)
    else:
        assert "/robot_description" not in messages


def floats(file: pygltflib.GLTF2, index: int) -> Array:
    accessor = file.accessors[index]
    view = file.bufferViews[accessor.bufferView]
    width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
    values = np.frombuffer(
        file.binary_blob(),
        dtype="<f4",
        count=accessor.count * width,
        offset=view.byteOffset + accessor.byteOffset,
    )
    return values.reshape(-1, width).astype(np.float64)


def z_up(transform: Array) -> Array:
    """Return a transform of the scene, rotated back to the planner's axes."""
    return transform_of([[1, 0, 0], [0, 0, -1], [0, 1, 0]], 0.0) @ transform


def test_glb_scene_stands_folded_and_upright(plan: Plan) -> None:
    scene: Any = trimesh.load_scene(io.BytesIO(exported("glb", plan)), file_type="glb")
    nodes = [scene.graph[f"module_{i}"] for i in range(len(plan.chain))]
    node_poses = [z_up(transform) for transform, _ in nodes]
    same_poses(node_poses, plan, len(plan.time_s) - 1, 1e-4)
    edge = plan.certificate.module_size * plan.chain.pitch_m
    looks: set[tuple[str, str]] = set()
    for i, (_, name) in enumerate(nodes):
        mesh, piece = scene.geometry[name].copy(), plan.chain.module.piece(i)
        mesh.merge_vertices(merge_norm=True)
        assert len(piece.parts) > 1 or mesh.is_watertight
        assert mesh.volume == pytest.approx(piece.volume * edge**3, rel=1e-5)
        looks.add((piece.name, str(mesh.visual.material.baseColorFactor)))
    # Two pieces in turn, and three colours in turn.
    assert len(looks) == (6 if plan.chain.module.name == BRACKETS.name else 1)


def test_glb_scene_moves_as_the_plan(plan: Plan) -> None:
    file: Any = pygltflib.GLTF2.load_from_bytes(exported("glb", plan))
    (animation,) = file.animations
    chain = plan.chain
    assert len(animation.channels) == 2 * len(chain)
    tracks: dict[tuple[int, str], tuple[Array, Array]] = {}
    for channel in animation.channels:
        sampler = animation.samplers[channel.sampler]
        assert sampler.interpolation == "LINEAR"
        times = floats(file, sampler.input)[:, 0]
        index = int(file.nodes[channel.target.node].name.removeprefix("module_"))
        tracks[index, channel.target.path] = (times, floats(file, sampler.output))
    times = tracks[0, "translation"][0]
    keys = [int(np.abs(plan.time_s - t).argmin()) for t in times]
    assert (keys[0], keys[-1]) == (0, len(plan.time_s) - 1)
    assert keys == sorted(set(keys))
    for k, frame in enumerate(keys):
        joint_values = []
        for i in range(len(chain)):
            rotation = Rotation.from_quat(tracks[i, "rotation"][1][k]).as_matrix()
            joint_values.append(transform_of(rotation, tracks[i, "translation"][1][k]))
        same_poses(joint_values, plan, frame, 1e-4)
    # Between keyframes a player interpolates along the shorter arc.
    for i in range(len(chain)):
        turns = tracks[i, "rotation"][1]
        assert ((turns[1:] * turns[:-1]).sum(axis=1) > 0).all()


def largest_error(plan: Plan, track: glb.Track) -> float:
    """Return the largest distance of the plan's frames from a player's track, pitches."""
    times = track.time_s.astype(np.float32).astype(np.float64)
    inside = np.clip(plan.time_s, times[0], times[-1])
    poses = plan.chain.poses(plan.joint_angles_rad, plan.root_position, plan.root_wxyz)
    errors = [0.0]
    for i in range(len(plan.chain)):
        drawn = np.stack([np.interp(inside, times, axis) for axis in track.positions[:, i].T], 1)
        arcs = Slerp(times, Rotation.from_quat(track.wxyzs[:, i], scalar_first=True))(inside)
        turns, wxyzs = arcs.as_quat(scalar_first=True), poses.wxyzs[:, i]
        off = np.stack([turns - wxyzs, turns + wxyzs])
        errors.append(np.linalg.norm(drawn - poses.positions[:, i], axis=1).max())
        errors.append(np.linalg.norm(off, axis=2).min(axis=0).max())
    return float(max(errors))


def test_glb_keyframes_keep_their_tolerance_between_each_other(
    plan: Plan, monkeypatch: Any
) -> None:
    track = glb.track_of(plan)
    assert largest_error(plan, track) <= glb.MIN_KEYFRAME_TOLERANCE + 1e-4
    for maximum in (5, 24):
        limit = maximum * len(plan.chain) * glb.POSE_BYTES_SINGLE
        monkeypatch.setattr(glb, "MAX_KEYFRAME_BYTES", limit)
        track = glb.track_of(plan)
        assert 2 <= len(track.time_s) <= maximum
        assert largest_error(plan, track) <= track.tolerance + 1e-5
        assert (track.time_s[0], track.time_s[-1]) == (plan.time_s[0], plan.time_s[-1])
        assert maximum > 9 or track.tolerance > glb.MIN_KEYFRAME_TOLERANCE


def test_stl_module_is_a_closed_solid_in_millimetres(plan: Plan) -> None:
    data = exported("stl", plan)
    assert not data.startswith(b"solid")
    mesh: Any = trimesh.load_mesh(io.BytesIO(data), file_type="stl")
    edge = plan.certificate.module_size * plan.chain.pitch_m * 1000.0
    pieces = plan.chain.module.pieces
    assert mesh.volume == pytest.approx(sum(p.volume for p in pieces) * edge**3, rel=1e-6)
    if len(pieces) > 1:  # two pieces beside each other, one of touching parts
        assert np.ptp(mesh.vertices[:, 0]) > 2.0 * BRACKETS.radius * edge
        return
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert np.abs(mesh.center_mass).max() < 1e-5 * edge


@pytest.mark.parametrize("export", PLAIN_EXPORTS, ids=lambda export: export.name)
def test_hostile_name_of_a_plan_leaves_exports_valid(ring: Plan, export: Export) -> None:
    chain = dataclasses.replace(ring.chain, name=HOSTILE_NAME)
    playback = {**(ring.playback or {}), "rest_frames": [0, len(ring.time_s) - 1]}
    data = export.write(dataclasses.replace(ring, chain=chain, playback=playback))
    if export.media_type == "application/xml":
        root = ElementTree.fromstring(data)
        named = root.get("name", "")
        assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", named) or root.tag == "mujoco"
    elif export.name == "glb":
        length = struct.unpack_from("<I", data, 12)[0]
        name = json.loads(data[20 : 20 + length])["nodes"][-1]["name"]
        assert name.isprintable()
    elif export.name == "leaflet-html":
        assert b"<robot" not in data
        assert b"</robot" not in data
    elif export.name == "steps":
        assert json.loads(data)["name"].isprintable()
    elif export.name == "mcap":
        assert len(decode_log(data)) > len(ring.time_s)


def test_plan_without_frames_is_refused_by_moving_exports(ring: Plan) -> None:
    none = {"motion": ring.motion[:0], "max_error_rad": ring.max_error_rad[:0]}
    still = dataclasses.replace(ring, playback=None, **none)
    for export in PLAIN_EXPORTS:
        with pytest.raises(InputError, match="no frames") if export.moving else nullcontext():
            assert export.write(still)


def test_formats_without_their_packages_are_left_out_and_refused_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for package in ("mcap_ros2", "reportlab"):
        monkeypatch.setitem(sys.modules, package, None)
    offered = {export.name for export in exports_of(moving=True, resting=True, coded=True)}
    missing = {export.name for export in EXPORTS} - offered
    assert missing == {"mcap", "leaflet", "leaflet-letter"}
    for name in missing:
        with pytest.raises(InputError, match=r"pip install 'foldback\[exports\]'"):
            export_named(name)
