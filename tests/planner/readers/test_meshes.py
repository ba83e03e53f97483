import base64
import json
import struct
import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.errors import InputError
from foldback.planner.readers import off, read, stl
from foldback.planner.shapes.mesh_repair import is_surface
from foldback.planner.shapes.solid import Solid, signed_volume
from tests.case import case
from tests.planner.reading import refusal_of, solid_in
from tests.planner.solids_made import MESH_KINDS, box, exported, scene, show, torus, zipped
from tests.refusal import refused

TETRA_OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"


def volume_in(data: bytes) -> float:
    solid = solid_in(data)
    assert solid.oriented, solid.notes
    return signed_volume(solid.vertices, solid.faces)


def upright(kind: str, extents: np.ndarray) -> np.ndarray:
    """Return the size of a mesh after reading: y is up in glTF."""
    return extents[[0, 2, 1]] if kind in ("glb", "gltf") else extents


@pytest.mark.parametrize("kind", MESH_KINDS)
def test_meshes_written_by_trimesh_are_read(kind: str) -> None:
    mesh = torus()
    data = exported(kind, mesh)
    for filename, name in (("some ring.stl", "some ring"), ("ring.json", "ring"), (None, "solid")):
        solid = solid_in(data, filename)
        assert (len(solid), len(solid.vertices)) == (len(mesh.faces), len(mesh.vertices))
        assert solid.notes == ()
        volume = signed_volume(solid.vertices, solid.faces)
        assert volume == pytest.approx(mesh.volume, rel=1e-5)
        np.testing.assert_allclose(solid.extents, upright(kind, mesh.extents), rtol=1e-5)
        assert solid.name == name
    assert refusal_of(data, max_triangles=500).code == "too-many-triangles"
    assert refusal_of(data, max_bytes=500).code == "too-large"
    assert isinstance(read(data, max_triangles=576, max_cells=10), Solid) or kind == "gltf"


@pytest.mark.parametrize("kind", ["glb", "gltf", "3mf"])
def test_parts_of_a_scene_are_placed_by_its_nodes(kind: str) -> None:
    scene = trimesh.Scene()
    turn = trimesh.transformations.rotation_matrix(0.3, [1, 1, 1])
    for shift in (0.0, 5.0, 11.0):
        place = trimesh.transformations.translation_matrix([shift, 0, 0]) @ turn
        scene.add_geometry(box(1, 2, 3), transform=place)
    if kind == "gltf":
        data = scene.export(file_type="gltf", embed_buffers=True)["model.gltf"]
    else:
        data = scene.export(file_type=kind)
    solid = solid_in(data)
    assert signed_volume(solid.vertices, solid.faces) == pytest.approx(18, rel=1e-4)
    np.testing.assert_allclose(solid.extents, upright(kind, scene.extents), rtol=1e-4)


TRIANGLES = b"f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
POINTS = TETRA_OBJ.removesuffix(TRIANGLES)
OBJ_VARIANTS = {
    "quads": b"v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
    b"f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n",
    "from the end": POINTS + b"f -4 -2 -3\nf -4 -3 -1\nf -3 -2 -1\nf -2 -4 -1\n",
    "from the end of what is there so far": b"".join(
        b"v %d 0 0\nv %d 0 0\nv %d 1 0\nv %d 0 1\n" % (x, x + 1, x, x)
        + b"f -4 -2 -3\nf -4 -3 -1\nf -3 -2 -1\nf -2 -4 -1\n"
        for x in (0, 5)
    ),
    "polygons of five corners": b"v 0 0 0\nv 2 0 0\nv 1 2 0\nv 1 0 0\nv 0.5 1 0\n"
    b"v 0 0 1\nv 2 0 1\nv 1 2 1\nv 1 0 1\nv 0.5 1 1\n"
    b"f 5 3 2 4 1\nf 6 9 7 8 10\nf 1 4 9 6 6\nf 4 2 7 9 9\nf 2 3 8 7 7\nf 3 5 10 8 8\n"
    b"f 5 1 6 10 10\n",
    "materials, normals, groups": b"mtllib http://example.com/secret.mtl\nvn 0 0 1\nvt 0 0\n"
    + POINTS
    + b"g v\nusemtl x\nf 1/1/1 3/1/1 2/1/1\ns off\nf 1/2 2//3 4\nf 2//1 3//1 4//1\nf 3 1/7 4",
    "colours": TETRA_OBJ.replace(b"v 0 0 1", b"v 0 0 1 0.5 0.5 0.5"),
    "cut after a space": TETRA_OBJ.rstrip() + b" ",
    "continued lines": TETRA_OBJ.replace(b"f 1 3 2", b"f 1 \\\r\n3 2"),
    "tabs and indents": TETRA_OBJ.replace(b"v 1", b"\tv\t1e0").replace(b"f 1", b"  f\t1"),
    "remarks": b"# f 1 1 1\n" + TETRA_OBJ.replace(b"v 1 0 0", b"v 1 0 0 # here"),
}
VOLUMES = {
    "quads": 1.0,
    "from the end of what is there so far": 1 / 3,
    "polygons of five corners": 2.0,
}


def test_variants_of_obj_files_are_read() -> None:
    for way, data in OBJ_VARIANTS.items():
        with case(way):
            assert volume_in(data) == pytest.approx(VOLUMES.get(way, 1 / 6))


def stl_text(*facets: bytes) -> bytes:
    facet = b"facet normal 0 0 0\nouter loop\n%b\nendloop\nendfacet\n"
    return b"solid s\n" + b"".join(facet % corners for corners in facets) + b"endsolid s\n"


FACETS = (
    b"vertex 0 0 0\nvertex 0 1.5 0\nvertex 1.5 0 0",
    b"vertex 0 0 0\nvertex 1.5 0 0\nvertex 0 0 1.5",
    b"vertex 1.5 0 0\nvertex 0 1.5 0\nvertex 0 0 1.5",
    b"vertex 0 1.5 0\nvertex 0 0 0\nvertex 0 0 1.5",
)


def test_text_that_trimesh_reads_as_another_mesh_is_refused() -> None:
    for data, code in (
        # trimesh omits bytes that are not text, which changes the content.
        (stl_text(*FACETS).replace(b"1.5", b"1\xff.5", 1), "not-a-number"),
        (TETRA_OBJ.replace(b"v 1 0 0", b"v 1\xff0 0 0"), "damaged"),
        (TETRA_OBJ.replace(b"f 1 3 2", b"f 1\xff 3 2"), "damaged"),
        # The total count of numbers is right, but not every row has three.
        (stl_text(*FACETS).replace(b"vertex 0 0 0", b"vertex 0 0", 1), "damaged"),
        (TETRA_OBJ.replace(b"v 1 0 0", b"v 1 0").replace(b"v 0 0 1", b"v 0 0 1 9"), "damaged"),
        # trimesh omits such a polygon, and the hole would be closed.
        (TETRA_OBJ.replace(b"f 1 3 2", b"f 1x3 2"), "damaged"),
        (TETRA_OBJ.replace(b"f 1 3 2", b"f -5 3 2"), "bad-index"),
    ):
        with case((data, code)):
            assert volume_in(stl_text(*FACETS)) == pytest.approx(1.5**3 / 6)
            assert refusal_of(data, filename="a.stl").code == code


OTHER_PROPERTIES = {
    "property uchar red": ([200], "B"),
    "property float quality": ([0.5], "f"),
    "property list uchar float texcoord": ([6, 0.0, 1.0, 0.5, 0.25, 1.0, 0.0], "B6f"),
    "property list ushort int flags": ([0], "H"),
}
"""Properties without effect on the shape, with the values of a row and their binary format."""
property_lists = st.lists(st.sampled_from(sorted(OTHER_PROPERTIES)), max_size=3)


@given(
    mark=st.sampled_from(["", "<", ">"]),
    axes=st.permutations(["x", "y", "z"]),
    around=st.tuples(property_lists, property_lists, property_lists, property_lists),
    camera=st.booleans(),
    faces_first=st.booleans(),
    beyond=st.integers(0, 6),
)
def test_ply_with_other_properties_and_elements_is_read(
    mark: str,
    axes: list[str],
    around: tuple[list[str], list[str], list[str], list[str]],
    camera: bool,
    faces_first: bool,
    beyond: int,
) -> None:
    """Other properties, further elements, and words unknown to the header are ignored."""
    points = [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 2.0) for z in (0.0, 3.0)]
    sides = [(0, 1, 3), (0, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4)]
    sides.append((1, 5, 7, 3))
    before, after, left_part, right = around
    axis_indices = {"x": 0, "y": 1, "z": 2}
    vertex = (
        [*before, *(f"property double {axis}" for axis in axes), *after],
        [([point[axis_indices[axis]] for axis in axes], "3d") for point in points],
        (before, after),
        "vertex",
    )
    face = (
        [*left_part, "property list uchar int vertex_indices", *right],
        [([len(side), *side], f"B{len(side)}i") for side in sides],
        (left_part, right),
        "face",
    )
    head, body = [], b""
    for names, rows, (first, last), element in [face, vertex] if faces_first else [vertex, face]:
        if camera:
            head += [f"element camera_of_{element} 1", "property float view"]
            body += struct.pack(f"{mark}f", 0.5) if mark else b"0.5\n"
        head += [f"element {element} {len(rows)}", *names]
        for values, packed in rows:
            parts = [
                *(OTHER_PROPERTIES[name] for name in first),
                (values, packed),
                *(OTHER_PROPERTIES[name] for name in last),
            ]
            if mark:
                body += b"".join(
                    struct.pack(mark + item_format, *part) for part, item_format in parts
                )
            else:
                words = [*(word for part, _ in parts for word in part), *[9] * beyond]
                body += " ".join(map(str, words)).encode() + b"\n"
    order = {"": "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}[mark]
    lines = ["ply", f"format {order} 1.0", *head, "end_header", ""]
    if not (mark or beyond):  # text lines may be wrapped anywhere
        body = b"\n".join(body.split())
    assert volume_in("\n".join(lines).encode() + body) == pytest.approx(6)


def test_flat_meshes_are_refused_with_their_size() -> None:
    first_refusal = refusal_of(b"v 0 0 0\nv 3 0 3\nv 0 3 3\nf 1 2 3\n")
    assert first_refusal.code == "flat"
    assert "a flat mesh of one triangle, which measures 3 × 3 × 3" in first_refusal.detail
    two = refusal_of(b"v 0 0 0\nv 3 0 0\nv 0 3 0\nv 3 3 0\nf 1 2 3\nf 2 3 4\n")
    assert "a flat mesh of 2 triangles, which measures 3 × 3 × 0" in two.detail


def test_off_with_comments_and_colours_is_read() -> None:
    body = b"0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1 255 0 0\n3 0 1 3\n3 1 2 3\n3 2 0 3\n"
    for head in (b"OFF\n4 4 6\n", b"OFF # d\n\n4 4 6 # e\n", b"OFF 4 4 6\n"):
        assert volume_in(head + body) == pytest.approx(1 / 6), head


def test_binary_stl_with_another_count_or_head() -> None:
    data = exported("stl", torus())
    extra = data[:80] + struct.pack("<I", 100_000) + data[84:]
    assert refusal_of(extra, filename="x.stl").code == "truncated"
    assert "100000 triangles, but the file has 576" in refusal_of(extra, filename="x.stl").detail
    assert refusal_of(data[:-20], filename="x.STL").code == "truncated"
    noted = solid_in(data + b"tail", "x.stl")
    assert "ignored" in noted.notes[0]
    assert refusal_of(data + bytes(9999), filename="x.stl").code == "damaged"
    for head, name in ((b"solid facet normal", "x.stl"), (b"GIF89a", "x.bin")):
        assert len(solid_in(head.ljust(80) + data[80:], name)) == 576, head


def test_other_files_named_stl_are_called_by_their_kind() -> None:
    noise = np.random.default_rng(0).bytes(5_000_000)
    for data, words in ((noise, "a binary file"), (b"GIF89a" + noise, "a GIF picture")):
        refusal = refusal_of(data, filename="thing.stl")
        assert refusal.code == "wrong-kind"
        assert words in refusal.detail
        assert "simplify" not in refusal.detail


def test_geometry_in_other_files_is_refused() -> None:
    key = "buffers"
    for uri in ("http://127.0.0.1:1/x.bin", "../../etc/passwd", "file:///etc/x"):
        text = scene(lambda d, uri=uri: d.setdefault(key, [{}])[0].update(uri=uri))
        refusal = refusal_of(text)
        assert (refusal.code, refusal.where) == ("outside-reference", f"{key}[0]"), uri
        text += b" " * (-len(text) % 4)
        glb = b"glTF" + struct.pack("<IIII", 2, 20 + len(text), len(text), 0x4E4F534A) + text
        assert refusal_of(glb).code == "outside-reference", uri


def changed_primitive(document: dict, **values: object) -> None:
    document["meshes"][0]["primitives"][0].update(values)


def add_accessor(document: dict, column: np.ndarray, **extra: object) -> int:
    """Add an accessor of (count, width) values to a scene and return its number."""
    uri = "data:;base64," + base64.b64encode(column.tobytes()).decode()
    document["buffers"].append({"uri": uri, "byteLength": column.nbytes})
    view = {"buffer": len(document["buffers"]) - 1, "byteLength": column.nbytes}
    document["bufferViews"].append(view)
    code = {"u1": 5121, "i2": 5122, "u4": 5125, "f4": 5126}[column.dtype.str[1:]]
    kind = {1: "SCALAR", 3: "VEC3"}[column.shape[1]]
    accessor = {"bufferView": len(document["bufferViews"]) - 1, "componentType": code}
    document["accessors"].append({**accessor, "count": len(column), "type": kind, **extra})
    return len(document["accessors"]) - 1


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])


def corners_as(document: dict, mode: int, order: list[int]) -> None:
    points = add_accessor(document, CORNERS.astype("<f4"))
    corners = add_accessor(document, np.array(order, dtype="<u4")[:, None])
    changed_primitive(document, attributes={"POSITION": points}, indices=corners, mode=mode)


def fan_on_a_triangle(document: dict) -> None:
    corners_as(document, 6, [3, 0, 1, 2, 0])
    fan = dict(document["meshes"][0]["primitives"][0])
    corners_as(document, 4, [0, 2, 1])
    document["meshes"][0]["primitives"].append(fan)


def in_steps(document: dict) -> None:
    points = add_accessor(document, (CORNERS * 32767).astype("<i2"), normalized=True)
    document["bufferViews"][-1]["byteOffset"] = 0
    corners = add_accessor(document, np.array([[0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3]], dtype="u1").T)
    changed_primitive(document, attributes={"POSITION": points}, indices=corners)


def bare(document: dict) -> None:
    points = add_accessor(document, CORNERS[[0, 2, 1, 0, 1, 3, 1, 2, 3, 2, 0, 3, 1]].astype("<f4"))
    document["meshes"][0]["primitives"] = [{"attributes": {"POSITION": points}}]


LENS = {"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1, "aspectRatio": 1}}
SCENES = {
    "a strip": (lambda d: corners_as(d, 5, [0, 2, 1, 3, 0, 2]), 1 / 6),
    "a fan and a triangle": (fan_on_a_triangle, 1 / 6),
    "whole numbers": (in_steps, 1 / 6),
    "places alone, and one too many": (bare, 1 / 6),
    "no scenes": (lambda d: (d.pop("scenes"), d.pop("scene")), 18.26227),
    "no nodes": (lambda d: (d.pop("scenes"), d.pop("scene"), d.pop("nodes")), 18.26227),
    "a camera": (lambda d: show(d, {"camera": 0}, cameras=[LENS]), 18.26227),
    "mirrored": (lambda d: show(d, {"scale": [-1, 2, 1]}), 2 * 18.26227),
    "of one name": (
        lambda d: show(d, *({"name": "world", "translation": [9 * i, 0, 0]} for i in range(3))),
        3 * 18.26227,
    ),
    "what is not used is broken": (
        lambda d: d["accessors"].append({**d["accessors"][0], "count": 10**9}),
        18.26227,
    ),
    "points beside": (
        lambda d: d["meshes"][0]["primitives"].append(
            {**d["meshes"][0]["primitives"][0], "mode": 0}
        ),
        18.26227,
    ),
}


@pytest.mark.parametrize("way", SCENES)
def test_variants_of_scenes_are_written_and_read(way: str) -> None:
    change, volume = SCENES[way]
    solid = solid_in(scene(change, torus()))
    assert signed_volume(solid.vertices, solid.faces) == pytest.approx(volume, rel=1e-4)
    assert solid.notes == (("points and lines were ignored.",) if way == "points beside" else ())


def test_long_chain_of_nodes_is_followed() -> None:
    document = json.loads(exported("gltf", torus()))
    links = 4_000
    document["nodes"] = [{"translation": [0, 0, 1], "children": [i + 1]} for i in range(links)]
    document["nodes"] += [{"mesh": 0}]
    for node in document["nodes"][-100:]:
        node["mesh"] = 0
    document["scenes"] = [{"nodes": [0]}]
    solid = solid_in(json.dumps(document).encode())
    assert -solid.vertices[:, 1].min() == pytest.approx(links + 0.7)


def corner_of_another_part(document: dict) -> None:
    corners_as(document, 4, [0, 2, 1, 0, 1, 4])
    document["meshes"][0]["primitives"] *= 2


def points_that_many_parts_share(document: dict) -> None:
    points = add_accessor(document, np.zeros((30_000, 3), dtype="<f4"))
    corners_as(document, 4, [0, 2, 1])
    changed_primitive(document, attributes={"POSITION": points})
    document["meshes"][0]["primitives"] *= 1_000


INVALID: list[tuple[Callable[[dict[str, Any]], object], str]] = [
    (lambda d: d["accessors"][1].update(count=10**12), "truncated"),
    (lambda d: d["accessors"][0].update(count=-3), "damaged"),
    (lambda d: d["accessors"][0].update(sparse={}), "unsupported"),
    (lambda d: d["accessors"][0].update(byteOffset=-4), "damaged"),
    (lambda d: d["accessors"][0].update(bufferView=77), "damaged"),
    (lambda d: d["bufferViews"][0].update(byteLength=8), "truncated"),
    (lambda d: d.update(nodes=[{"children": [0]}], scenes=[{"nodes": [0]}]), "damaged"),
    (lambda d: d.update(nodes=[{}] * 200_000), "too-large"),
    (lambda d: d.update(nodes=[{"mesh": 0, "scale": [1e300] * 3}]), "too-far"),
    (lambda d: d.update(nodes=[{"mesh": 0, "matrix": [1.0] * 5}]), "damaged"),
    (lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]), "unsupported"),
    (lambda d: d.update(meshes=[]), "damaged"),
    (lambda d: d.update(buffers=[{"uri": "data:;base64,%%%"}]), "damaged"),
    (corner_of_another_part, "bad-index"),
    (points_that_many_parts_share, "too-large"),
    (lambda d: show(d, *[{}] * 5_000), "too-many-triangles"),
]


def test_invalid_scenes_are_refused() -> None:
    for number, (change, code) in enumerate(INVALID):
        with case((number, code)):
            assert refusal_of(scene(change, torus())).code == code


MODEL = """<?xml version="1.0"?><model unit="millimeter"
 xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>{}</resources>
<build>{}</build></model>"""
MESH = """<object id="1" type="model"><mesh><vertices><vertex x="0" y="0" z="0"/>
<vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/><vertex x="0" y="0" z="1"/></vertices>
<triangles><triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/>
<triangle v1="1" v2="2" v3="3"/><triangle v1="2" v2="0" v3="3"/></triangles></mesh></object>"""


def model(resources: str, build: str = '<item objectid="1"/>') -> bytes:
    return zipped(**{"3D__3dmodel_model": MODEL.format(resources, build).encode()})


def components(number: int, *parts: str) -> str:
    """Return an object of other objects, each given by its number and further attributes."""
    inner = "".join(f'<component objectid="{part}"/>' for part in parts)
    return f'<object id="{number}"><components>{inner}</components></object>'


def test_parts_of_a_3mf_are_moved_and_mirrored() -> None:
    parts = components(2, "1", '1" transform="-2 0 0 0 1 0 0 0 1 -9 0 0')
    data = model(MESH + parts, '<item objectid="2" transform="1 0 0 0 1 0 0 0 3 0 0 0"/>')
    assert volume_in(data) == pytest.approx((1 + 2) * 3 / 6)


def test_3mf_with_too_many_repeated_parts_is_refused() -> None:
    parts = "".join(components(i, str(i - 1), str(i - 1)) for i in range(2, 45))
    assert refusal_of(model(MESH + parts, '<item objectid="44"/>')).code == "too-large"


def test_archives_without_a_model_are_refused() -> None:
    for data, code in (
        (zipped(readme=b"hello"), "wrong-kind"),
        (lambda: zipped(a_model=b" " * (64 << 20)), "bomb"),
        (lambda: zipped(a_model=b"<model>" + b"<x/>" * (10 << 20)), "bomb"),
        (zipped(a_model=b"<!DOCTYPE x [<!ENTITY a 'aaaa'>]><model>&a;</model>"), "damaged"),
        (zipped(a_model=b"<model>"), "damaged"),
        (model(MESH, '<item objectid="7"/>'), "damaged"),
        (model(components(1, "1")), "damaged"),
        (model(MESH.replace('v3="1"', 'v3="-1"')), "bad-index"),
        (model(MESH.replace('x="1"', 'x="nan"')), "not-finite"),
        (model(MESH.replace('x="1"', "")), "damaged"),
        (model(MESH, '<item objectid="1" transform="1 2 3"/>'), "damaged"),
        (b"PK\x03\x04" + bytes(60), "damaged"),
    ):
        with case((data, code)):
            assert refusal_of(data() if callable(data) else data).code == code


def test_archive_with_a_false_size_is_refused() -> None:
    data = bytearray(zipped(a_model=b"<model>" + b" " * (64 << 20)))
    true = struct.pack("<I", 7 + (64 << 20))
    while (at := data.find(true)) >= 0:
        data[at : at + 4] = struct.pack("<I", 1000)
    assert refusal_of(bytes(data)).code in ("damaged", "bomb")


def test_bad_meshes_are_refused_with_their_place() -> None:
    for data, code, error_place in (
        (b"OFF\n9999999999 9999999999 0\n", "truncated", None),
        (b"OFF\n1 1 0\n0 0 0\n9 0 0 0\n", "damaged", "line 4"),
        (b"OFF BINARY\n", "unsupported", None),
        (b"ply\nformat ascii 1.0\n", "truncated", None),
        (b"ply\nformat ascii 1.0\nelement vertex 999999999999\nend_header\n", "damaged", None),
        (b"ply\nproperty float x\nend_header\n", "damaged", None),
        (b"glTF\x02\0\0\0", "truncated", None),
        (b"glTF" + struct.pack("<II", 1, 12), "wrong-version", None),
        (b"glTF" + struct.pack("<II", 2, 9999), "truncated", None),
        (b"glTF" + struct.pack("<II", 2, 12), "damaged", None),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", "bad-index", "line 4"),
        (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 0\n", "damaged", "line 4"),
        (b"v 0 0\nf 1 2 3\n", "damaged", "line 1"),
        (b"v 0 0 0\nv 1 0 0\n", "no-triangles", None),
        (TETRA_OBJ.replace(b"1 0 0", b"nan 0 0"), "not-finite", "vertex 1"),
        (stl_text(b"vertex 0 0 0"), "damaged", None),
    ):
        with case((data, code)):
            refusal = refusal_of(data)
            assert (refusal.code, refusal.where) == (code, error_place)


@pytest.mark.slow
def test_reading_does_not_load_libraries_that_only_others_need() -> None:
    code = (
        "import sys\nfrom foldback.planner.readers import read\nread(sys.stdin.buffer.read())\n"
        "assert not {'trimesh', 'networkx', 'lxml'} & set(sys.modules)"
    )
    ball = trimesh.creation.icosphere(subdivisions=1).export(file_type="stl")
    subprocess.run([sys.executable, "-c", code], input=ball, check=True)


@pytest.fixture
def triangles(monkeypatch: pytest.MonkeyPatch) -> list[tuple[np.ndarray, np.ndarray]]:
    """List of the vertices and faces that readers return; no solid is made of them."""
    mesh_parts: list[tuple[np.ndarray, np.ndarray]] = []

    def collect(vertices: np.ndarray, faces: np.ndarray, **extra: object) -> None:
        mesh_parts.append((np.asarray(vertices), np.asarray(faces)))

    monkeypatch.setattr(Solid, "from_triangles", collect)
    return mesh_parts


def test_off_lines_give_the_same_mesh_at_once_and_one_by_one(
    triangles: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    data = mesh.export(file_type="off").encode()
    read(data, filename="ball.off")
    monkeypatch.setattr(off, "_many", lambda *arguments: None)
    read(data, filename="ball.off")
    (points, faces), (slow_points, slow_faces) = triangles
    assert len(faces) == len(mesh.faces)
    np.testing.assert_array_equal(points, slow_points)
    np.testing.assert_array_equal(faces, slow_faces)


SAME_STL = {
    "as it is": lambda text: text,
    "in capitals": bytes.upper,
    "with exponents": lambda text: text.replace(b"vertex 0.0 ", b"Vertex 0.0E+00 "),
    "on one line": lambda text: b" ".join(text.split()),
    "with a word a line": lambda text: b"\n".join(text.split()),
    "with other line ends": lambda text: text.replace(b"\n", b"\r\n"),
    "called after its words": lambda text: text.replace(b"solid", b"solid vertex facet", 1),
    "as two solids": lambda text: text.replace(b"endfacet", b"endfacet\nendsolid x\nsolid", 1),
    "with normals that are none": lambda text: text.replace(b"normal 0", b"normal -nan(ind)"),
}


@pytest.mark.parametrize("part", [1, 4000, 1 << 20])
def test_variants_of_stl_text_give_the_same_mesh(
    part: int, triangles: list, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stl, "PART_BYTES", part)
    mesh = trimesh.creation.icosphere(subdivisions=1)
    text = mesh.export(file_type="stl_ascii").encode()
    for way, written in SAME_STL.items():
        read(written(text), filename="ball.stl")
        points, faces = triangles.pop()
        with case(way):
            np.testing.assert_array_equal(points[faces], mesh.triangles)


def test_sewn_and_loose_meshes_are_surfaces() -> None:
    mesh = trimesh.creation.torus(2.0, 0.8, major_sections=200, minor_sections=100)
    assert is_surface(mesh.vertices, mesh.faces)
    loose = np.asarray(mesh.triangles).reshape(-1, 3)
    assert is_surface(loose, np.arange(len(loose)).reshape(-1, 3))
    assert is_surface(mesh.vertices, mesh.faces[: len(mesh.faces) * 9 // 10])
    small = box(1.0, 2.0, 3.0)
    assert is_surface(small.vertices, small.faces)


def test_random_triangles_are_no_surface() -> None:
    rng, count = np.random.default_rng(0), 100_000
    for points in (300, count):
        assert not is_surface(rng.random((points, 3)), rng.integers(0, points, (count, 3)))
    with refused("not-a-surface"):
        Solid.from_triangles(rng.random((3 * count, 3)), np.arange(3 * count).reshape(-1, 3))


@pytest.mark.slow
def test_many_degenerate_triangles_are_refused_in_little_memory() -> None:
    data = b"OFF 3 400000 0\n0 0 0\n1 0 0\n0 1 0\n" + b"3 0 0 0\n" * 400_000
    tracemalloc.start()
    try:
        with pytest.raises(InputError) as refused:
            read(data, filename="same.off")
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert refused.value.code == "degenerate"
    assert peak < 100e6
