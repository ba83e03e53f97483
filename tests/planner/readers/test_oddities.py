"""Regression tests: small files with unusual content that were once read wrongly or crashed."""

import json
import re
from typing import Any

import numpy as np
import pytest
import trimesh

from foldback.planner.errors import InputError
from foldback.planner.readers import read
from foldback.planner.shapes.solid import Solid, signed_volume
from foldback.planner.shapes.voxelise import voxelise
from tests.planner.readers.test_faults import CORE, archive, mesh_xml
from tests.planner.readers.test_meshes import add_accessor
from tests.planner.reading import cells_of, refusal_of, solid_in
from tests.planner.solids_made import (
    Mesh,
    box,
    exported,
    scene,
    show,
    solid_of,
    vox_file,
    vox_model,
    vox_transform,
    zipped,
)

BOX = box(2, 3, 4)
OBJ = exported("obj", BOX)
OFF = exported("off", BOX)
PLY = exported("ply_ascii", BOX)
STL = exported("stl_ascii", BOX).rstrip() + b"\n"
XML = mesh_xml(2, 3, 4)


def volume_of(solid: Solid) -> float:
    return signed_volume(solid.vertices, solid.faces)


def moved(mesh: Mesh, *by: float, flip: bool = False, mirror: bool = False) -> Mesh:
    """Return a copy of a mesh that is moved, inside out, or triangulated another way."""
    other_mesh = Mesh(
        mesh.vertices * [-1, 1, 1] if mirror else mesh.vertices, mesh.faces, process=False
    )
    other_mesh.apply_translation(by or (0, 0, 0))
    if flip != mirror:
        other_mesh.invert()
    return other_mesh


def joined(*meshes: Mesh) -> Solid:
    return solid_of(trimesh.util.concatenate(meshes))


FAR = moved(BOX, 30, 0, 0)
TALL = moved(box(2, 3, 6), 0, 0, 1)
COINCIDING = {
    "both sides of each wall": ((BOX, moved(BOX, flip=True)), 24, 24),
    "both sides of each wall, beside another": ((BOX, moved(BOX, flip=True), FAR), 48, 0),
    "twice, in other triangles": ((BOX, moved(BOX, mirror=True)), 48, 24),
    "twice, in other triangles, beside another": ((BOX, moved(BOX, mirror=True), FAR), 72, 0),
    "with flush walls": ((BOX, TALL), 60, 36),
}
"""Meshes, the sum of the volumes of their bodies, and the number of cells of their union."""


@pytest.mark.parametrize("kind", COINCIDING)
def test_bodies_with_walls_on_each_other_do_not_vanish(kind: str) -> None:
    meshes, volume, cells = COINCIDING[kind]
    solid = joined(*meshes)
    assert solid.closed
    assert solid.oriented
    assert volume_of(solid) == pytest.approx(volume)
    assert not any("open" in note or "ignored" in note for note in solid.notes)
    if cells:
        assert len(voxelise(solid, cells=cells).shape) == cells


def test_part_without_volume_is_noted() -> None:
    sheet = Mesh([[50, 0, 0], [53, 0, 0], [50, 3, 0]], [[0, 1, 2], [0, 2, 1]], process=False)
    solid = joined(BOX, sheet)
    assert volume_of(solid) == pytest.approx(24)
    assert "1 part that encloses no volume was ignored." in solid.notes
    # A common wall of two bodies is not such a part.
    assert joined(BOX, moved(BOX, 2, 0, 0)).notes == ()


U = [(0, 0), (5, 0), (5, 5), (4, 5), (4, 1), (1, 1), (1, 5), (0, 5)]


def prism(corners: list[tuple[int, int]], is_reversed: bool = False) -> bytes:
    """Return an OBJ file of a prism with concave polygons."""
    count = len(corners)
    low = list(range(count))
    walls = [[i, (i + 1) % count, count + (i + 1) % count, count + i] for i in range(count)]
    faces = [low[::-1], [i + count for i in low], *walls]
    lines = [f"v {x} {y} {z}" for z in (0, 1) for x, y in corners]
    lines += [
        "f " + " ".join(str(k - 2 * count if is_reversed else k + 1) for k in f) for f in faces
    ]
    return "\n".join(lines).encode() + b"\n"


@pytest.mark.parametrize("is_reversed", [False, True])
def test_concave_polygon_with_corners_in_line_is_no_hole(is_reversed: bool) -> None:
    for start in range(len(U)):
        solid = solid_in(prism(U[start:] + U[:start], is_reversed))
        assert volume_of(solid) == pytest.approx(13)
        assert solid.closed
        assert not any("open" in note for note in solid.notes)


def test_only_vertices_and_polygons_of_obj_go_on_after_a_backslash() -> None:
    data = prism(U)
    for line in (b"# made in C:\\models\\\n", b"mtllib C:\\models\\\n", b"o a\\\n"):
        assert volume_of(solid_in(line + data)) == pytest.approx(13), line
    continued = data.replace(b"v 5 0 0", b"v 5 \\\n 0 \\\n0").replace(b" 2 1\n", b" 2\\\n 1\n")
    assert continued.count(b"\\") == 3
    assert volume_of(solid_in(continued)) == pytest.approx(13)
    # Line numbers are those of the file.
    assert refusal_of(continued.replace(b"v 0 5 0", b"v 0 5 x")).where == "line 10"


def test_comments_may_come_before_off() -> None:
    assert volume_of(solid_in(b"# made by a program\n\n# with love\n" + OFF)) == pytest.approx(24)


def with_floats_as_indices(document: dict[str, Any]) -> None:
    corners = add_accessor(document, (np.arange(36)[:, None] + 0.4).astype("<f4"))
    document["meshes"][0]["primitives"][0]["indices"] = corners


PERSPECTIVE = {"matrix": [1, 0, 0, 0.5, *[0, 1, 0, 0] * 2, 0, 0, 0, 1]}


def model_xml(encoding: str = "UTF-8", side: float = 2) -> bytes:
    text = (
        f"<?xml version='1.0' encoding='{encoding}'?><model xmlns='{CORE}'><resources>"
        f"{mesh_xml(side, 3, 4)}</resources><build><item objectid='1'/></build></model>"
    )
    return text.encode()


FLOATS_PLY = PLY.replace(b"list uchar int", b"list uchar float").replace(
    b"list uint8 int32", b"list uchar float"
)
POINT = "write decimals with a point"
REFUSED: dict[str, tuple[bytes, str, str]] = {
    "a truncated second solid": (STL + STL[: STL.rindex(b"facet normal")], "truncated", "endsolid"),
    "a vertex number that is not whole": (
        re.sub(rb"\n3 1 3 0", b"\n3 1.5 3 0", FLOATS_PLY, count=1),
        "damaged",
        "not a whole number",
    ),
    "an underscore in PLY": (PLY.replace(b"-1.0", b"-1_0.0", 1), "damaged", "-1_0.0"),
    "an underscore in OFF": (OFF.replace(b"-1.0", b"-1_0.0", 1), "damaged", "-1_0.0"),
    "an underscore in 3MF": (archive(XML.replace("-1.0", "-1_0.0", 1), 1), "damaged", "-1_0.0"),
    "foreign digits": (archive(XML.replace("1.0", "\u0661.0", 1), 1), "damaged", "\u0661"),
    "a position with an underscore": (
        vox_file(vox_model(np.array([[0, 0, 0]])), vox_transform(0, 1, _t="1_0 0 0")),
        "damaged",
        "no valid position",
    ),
    "decimal commas in OBJ": (OBJ.replace(b".", b","), "damaged", POINT),
    "decimal commas in OFF": (OFF.replace(b".", b","), "damaged", POINT),
    "decimal commas in 3MF": (archive(XML.replace("1.0", "1,0"), 1), "damaged", POINT),
    "commas between spaces": (b"0,0 0,0 0,0\n1,0 0,0 0,0\n2,0 0,0 0,0\n", "not-a-number", POINT),
    "commas alone": (b"0,0,0,0,0,0\n1,0,0,0,0,0\n2,0,0,0,0,0\n", "wrong-count", "6 fields"),
    "floats as indices": (scene(with_floats_as_indices), "damaged", "whole numbers"),
    "a matrix of perspective": (scene(lambda d: show(d, PERSPECTIVE)), "damaged", "last row"),
    "two models of one name": (
        zipped(**{"3D__a_model": model_xml(), "3D__A_model": model_xml(side=9)}),
        "damaged",
        "two models with the same name",
    ),
    "an unknown encoding": (zipped(a_model=model_xml("x-1")), "damaged", "encoding"),
    "supports alone": (archive(mesh_xml(2, 3, 4, kind="solidsupport"), 1), "empty", "supports"),
    "a shape of truth values": (
        b"\x93NUMPY\x01\x00\x36\x00{'descr':'<i8','fortran_order':False,'shape':(True,3)}"
        + bytes(24),
        "damaged",
        "(True, 3)",
    ),
    "quarter turns": (
        json.dumps({"format": "foldback-chain/1", "joint_angles_deg": [[1, 0], [0, -1]]}).encode(),
        "quarter-turns",
        "multiply them by 90",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_unusual_file_is_refused_by_name(kind: str) -> None:
    data, code, text = REFUSED[kind]
    refusal = refusal_of(data)
    assert refusal.code == code
    assert text in refusal.detail


SLICES = (
    '<s:slicestack xmlns:s="x" id="7"><s:slice ztop="1"><s:vertices><s:vertex x="0" y="0"/>'
    '</s:vertices></s:slice></s:slicestack><s:thing><s:triangle v1="0" v2="1" v3="2"/></s:thing>'
)


def test_elements_of_extensions_are_no_part_of_the_mesh() -> None:
    solid = solid_in(archive(XML + SLICES, 1))
    assert volume_of(solid) == pytest.approx(24)
    assert solid.notes == ()


def test_data_after_the_end_of_glb_is_noted() -> None:
    assert solid_in(exported("glb", BOX)).notes == ()
    assert "was ignored" in solid_in(exported("glb", BOX) + b"more").notes[0]


def test_instances_without_places_are_read_once_each() -> None:
    def instances(document: dict[str, Any]) -> None:
        numbers = add_accessor(document, np.zeros((1, 1), dtype="<u4"))
        extension = {"EXT_mesh_gpu_instancing": {"attributes": {"_ID": numbers}}}
        show(document, {"extensions": extension})

    assert volume_of(solid_in(scene(instances))) == pytest.approx(24)


def test_text_in_windows_encoding_is_read() -> None:
    rows = "x;y;z;Länge\n0;0;0;1\n1;0;0;1\n2;0;0;1\n"
    assert cells_of(rows.encode("cp1252")) == [[0, 0, 0], [1, 0, 0], [2, 0, 0]]
    assert "a binary file" in refusal_of(bytes(range(1, 255))).detail


PYTHON_WORDS = re.compile(
    r"[A-Z]\w+(?:Error|Exception)\b|NoneType|not convert|invalid literal|not supported between|"
    r"not enough values|subscriptable|has no attribute|required positional"
)
"""Words of Python's own errors, which are meaningless to users."""
BROKEN_SCENES: tuple[dict[str, Any], ...] = (
    {"scene": None},
    {"meshes": [{}]},
    {"meshes": [{"primitives": [{"attributes": {}}]}]},
    {"meshes": [None]},
    {"nodes": [{"mesh": 0, "rotation": [0, 1]}]},
    {"nodes": [{"mesh": "x"}]},
    {"nodes": [{"mesh": 0, "matrix": ["x"] * 16}]},
    {"nodes": [{"mesh": 7}]},
    {"accessors": {}},
    {"bufferViews": [{"buffer": 0}]},
    {"buffers": [7]},
)


def test_refusals_hold_no_words_of_python() -> None:
    files = [data for data, _, _ in REFUSED.values()]
    files += [scene(lambda d, c=change: d.update(c)) for change in BROKEN_SCENES]
    files += [data.replace(b"1", b"x") for data in (OBJ, OFF, PLY, STL)]
    files += [archive(XML.replace(a, b), 1) for a, b in (('z="', 'w="'), ('v1="', 'v1="x'))]
    refused = 0
    for data in files:
        try:
            read(data)
        except InputError as refusal:
            refused += 1
            assert not PYTHON_WORDS.search(refusal.detail), refusal.detail
    assert refused == len(files)
