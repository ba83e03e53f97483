"""Regression tests: a small file for each kind of input that was once read wrongly."""

import contextlib
import json
import struct
import time
from itertools import product
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

from foldback.planner.errors import InputError
from foldback.planner.readers import read
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid, signed_volume
from tests.case import case
from tests.planner.reading import cells_of, refusal_of, shape_in, solid_in
from tests.planner.solids_made import (
    box,
    chunk,
    exported,
    npy,
    scene,
    vox_file,
    vox_model,
    vox_shape,
    vox_transform,
    words,
    zipped,
)

DATA = FilePath(__file__).parent / "data"
L_OBJ = (DATA / "b01_bom.obj").read_bytes().removeprefix(b"\xef\xbb\xbf")
STAIRS = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0], [2, 1, 1], [2, 1, 2]]


def file_in(name: str) -> object:
    return read((DATA / name).read_bytes(), filename=name)


def test_read_mesh_gives_the_right_solid() -> None:
    for name, volume, extents, note in (
        ("a04_long_name.stl", 5, (4, 1, 2), ""),
        ("a12_two_one_inside_out.stl", 10, (5, 1, 3), "1 of 2 bodies was inside out"),
        ("a17_two_apart_one_inside_out.stl", 128, (10, 4, 4), "1 of 2 bodies was inside out"),
        ("b01_bom.obj", 5, (4, 1, 2), ""),
        ("b03_face_comment.obj", 5, (4, 1, 2), ""),
        ("c04_tristrips.ply", 5, (4, 1, 2), ""),
        ("d02_same.stl", 17, (4, 3, 6), ""),
        ("d02_y_up.glb", 17, (4, 3, 6), ""),
        ("d03_instancing_required.glb", 5, (4, 2, 1), ""),
        ("e02_negative_volume.3mf", 27000, (30, 30, 30), "cutters"),
        ("e06_not_printable.3mf", 5, (4, 1, 2), "not printed"),
    ):
        with case((name, volume)):
            solid = file_in(name)
            assert isinstance(solid, Solid)
            assert signed_volume(solid.vertices, solid.faces) == pytest.approx(volume)
            assert solid.extents == pytest.approx(extents)
            assert bool(solid.notes) == bool(note)
            assert note in "".join(solid.notes)


def test_read_voxels_gives_the_cells_in_sight() -> None:
    for name, cells, note in (
        ("f01_pack_frames.vox", 9, "2 frames"),
        ("f02_hidden_node.vox", 16, "hidden"),
        ("h01_float_grid.npy", 7, ""),
    ):
        with case((name, cells)):
            shape = file_in(name)
            assert isinstance(shape, Shape)
            assert len(shape) == cells
            assert note in "".join(shape.notes)
            assert bool(shape.notes) == bool(note)


def test_read_table_takes_columns_by_the_axis_they_name() -> None:
    for header in (
        *("z [mm],y [mm],x [mm]", "Z_mm;Y_mm;X_mm", "pos z\tpos y\tpos x", "zmm,ymm,xmm", "k,j,i"),
        *("c,b,a", "#z,y,x", "# z, y, x", "sep=;\nz;y;x", "z y x", "# z y x"),
        "z [mm] y [mm] x [mm]",
    ):
        separator = next(c for c in ";\t, " if c in header)
        rows = [separator.join(map(str, row[::-1])) for row in STAIRS]
        assert cells_of("\n".join([header, *rows]).encode()) == STAIRS, header
    # If there are more columns, the header names the coordinates.
    for header, separator in product(("step x y z", "i j k value", "x y z r g b"), (",", " ")):
        words = header.split()
        first = next(words.index(axis) for axis in "xi" if axis in words)
        rows = [[7] * first + row + [1] * (len(words) - first - 3) for row in STAIRS]
        data = "\n".join(separator.join(map(str, row)) for row in [words, *rows]).encode()
        assert cells_of(data) == STAIRS, header


def test_read_table_with_rows_unlike_the_header_is_refused() -> None:
    for row, code in ((b"1 0 0 0", "empty-cell"), (b"1 0", "wrong-count")):
        for separator in (b",", b" "):
            data = (b"x y z value\n0 0 0 1\n" + row).replace(b" ", separator)
            refusal = refusal_of(data, as_voxels=True)
            assert (refusal.code, refusal.where) == (code, "line 3"), data


def test_read_xyz_without_a_comment_and_csv_with_decimal_commas() -> None:
    rows = "\n".join(" ".join(map(str, row)) for row in STAIRS)
    assert cells_of(f"{len(STAIRS)}\n{rows}\n".encode()) == STAIRS
    for delimiter in (";", "\t"):
        rows = [delimiter.join(f"{value},0" for value in row) for row in STAIRS]
        assert cells_of("\n".join(rows).encode()) == STAIRS


def test_read_json_with_unread_keys_of_form_is_refused_by_name() -> None:
    for document in (
        *({"format": "foldback-path/1", key: 5} for key in ("units", "pitch_mm", "axes", "scale")),
        *({"format": "foldback-path/1", key: True} for key in ("closed", "module")),
        {"format": "foldback-voxels/1", "origin": [1, 2, 3]},
        {"format": "foldback-chain/1", "joint_angles_rad": [[0, 0], [1.57, 0]]},
    ):
        with case(document):
            arguments = {**document, "cells": STAIRS, "title": "Stairs", "tags": []}
            refusal = refusal_of(json.dumps(arguments).encode())
            assert refusal.code == "unknown-key"
            assert list(document)[1] in refusal.detail


ENCODINGS = ["utf-8-sig", "utf-16", "utf-32", "utf-16-le", "utf-16-be"]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_read_text_in_every_encoding(encoding: str) -> None:
    for kind in ("obj", "stl_ascii", "off", "ply_ascii", "gltf"):
        with case(kind):
            solid = solid_in(exported(kind, box(2, 3, 4)).decode().encode(encoding))
            assert abs(signed_volume(solid.vertices, solid.faces)) == pytest.approx(24)
    for text in (json.dumps(STAIRS), "\n".join(",".join(map(str, row)) for row in STAIRS)):
        assert cells_of(text.encode(encoding)) == STAIRS


RUNS = (b" ", b"\t", b"\n", b"\r", b"\r\n", b",", b";", b"[", b'"', b"#", b"0", b"-", b"\\\n")
FILE_STARTS = (
    *(b"", b"v 0 0 0\n", b"v 0 0 0\nf 1", b"solid x\nfacet\nvertex 0", b"OFF\n"),
    *(b"0,0,0\n", b"[[0,0,0],", b"ply\nformat ascii 1.0\n"),
)
"""First bytes of files of each kind."""


def seconds(data: bytes) -> float:
    """Return the smaller processor time of two readings, s."""
    spent: list[float] = []
    for _ in range(2):
        start = time.process_time()
        with contextlib.suppress(InputError):
            read(data, max_cells=100)
        spent.append(time.process_time() - start)
    return min(spent)


def test_read_long_runs_takes_time_in_proportion() -> None:
    # A reader of quadratic complexity would take 64 times as long for a run of eightfold length.
    for before, run in product(FILE_STARTS, RUNS):
        with case((before, run)):
            short, long = (before + run * n + b"x" for n in (5_000, 40_000))
            assert seconds(long) < 25 * seconds(short) + 0.1


TETRAHEDRON = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
PLY = exported("ply_ascii", box(1, 2, 3))
STL = exported("stl_ascii", box(1, 2, 3)).split(b"\n", 1)[1]


def test_read_mesh_with_other_line_ends_and_long_heads() -> None:
    for data, volume in (
        (b"# a remark\n" * 30_000 + TETRAHEDRON, 1 / 6),
        (TETRAHEDRON.replace(b"\n", b"\r"), 1 / 6),
        (PLY.replace(b"element vertex", b"comment end_header\nelement vertex", 1), 6),
        (PLY.replace(b"\n", b"\r"), 6),
        ((b"SOLID " + b"n" * 50_000 + b"\n" + STL).replace(b"\n", b"\r"), 6),
    ):
        with case((data, volume)):
            solid = solid_in(data)
            assert abs(signed_volume(solid.vertices, solid.faces)) == pytest.approx(volume)


def other_scene(document: dict[str, Any]) -> None:
    document["nodes"].append({"mesh": 0, "translation": [9, 0, 0]})
    document["scenes"].append({"nodes": [len(document["nodes"]) - 1]})


CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
RELATIONSHIPS = (
    "<Relationships><Relationship Target='/3D/main.model' Id='r' "
    "Type='http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel'/></Relationships>"
)
CURA = '<metadatagroup><metadata name="cura:{}">True</metadata></metadatagroup>'


def mesh_xml(*sides: float, inside: str = "", kind: str = "model", number: int = 1) -> str:
    mesh = box(*sides)
    points = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in mesh.vertices)
    rows = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in mesh.faces)
    return (
        f'<object id="{number}" type="{kind}">{inside}<mesh><vertices>{points}</vertices>'
        f"<triangles>{rows}</triangles></mesh></object>"
    )


def archive(objects: str, *items: int, required: str = "", **part_files: str) -> bytes:
    """Return a 3MF archive; further models come before the main one."""
    build = "".join(f'<item objectid="{number}"/>' for number in items)
    names = f'xmlns="{CORE}" xmlns:p="{PRODUCTION}" {required}'
    text = f"<model {names}><resources>{{}}</resources><build>{{}}</build></model>"
    first = '<item objectid="1"/>'
    files = {f"3D__{name}_model": text.format(second, first) for name, second in part_files.items()}
    files |= {"3D__main_model": text.format(objects, build), "_rels__.rels": RELATIONSHIPS}
    return zipped(**{name: content.encode() for name, content in files.items()})


def with_role(role: str) -> bytes:
    """Return an archive of a box of volume 24 and another one with a role in Cura."""
    other_mesh_xml = mesh_xml(1, 9, 1, inside=CURA.format(role), number=2)
    return archive(mesh_xml(2, 3, 4) + other_mesh_xml, 1, 2)


OFF = exported("off", box(2, 3, 4)).rstrip() + b"\n"
TEXT_PLY = exported("ply_ascii", box(2, 3, 4)).rstrip() + b"\n"
TEXT_STL = exported("stl_ascii", box(2, 3, 4)).rstrip() + b"\n"
FANS = b"element trifans 1\nproperty list int int vertex_indices\nend_header"


def test_read_mesh_with_more_content_notes_ignored_parts() -> None:
    for data, note in (
        (scene(other_scene), "outside of the scene"),
        (scene(lambda d: d["nodes"].append({"mesh": 0})), "outside of the scene"),
        (scene(lambda d: d["meshes"].append(d["meshes"][0])), "outside of the scene"),
        (scene(lambda d: d.update(animations=[{"channels": [], "samplers": []}])), "animations"),
        (archive(mesh_xml(2, 3, 4) + mesh_xml(1, 1, 1, number=2), 1), "not part of the build"),
        (archive(mesh_xml(2, 3, 4), 1, other=mesh_xml(9, 9, 9)), "not part of the build"),
        (archive(mesh_xml(2, 3, 4) + mesh_xml(1, 1, 1, kind="mould", number=2), 1, 2), "cutters"),
        *((with_role(role), "cutters") for role in ("infill_mesh", "support_mesh")),
        (OFF + b"3 0 1 2\n", "lines after the last polygon"),
        (TEXT_PLY + b"3 0 1 2\n", "after the last element"),
        (exported("ply", box(2, 3, 4)) + b"more", "after the last element"),
        (TEXT_PLY.replace(b"end_header", FANS, 1) + b"3 0 1 2\n", "trifans"),
        (TEXT_STL + exported("stl", box(1, 1, 1)), "after the last triangle"),
        (TEXT_STL + TEXT_STL.upper(), ""),
        (TEXT_STL.upper() + TEXT_STL, ""),
    ):
        with case((data, note)):
            solid = solid_in(data)
            assert signed_volume(solid.vertices, solid.faces) == pytest.approx(24)
            assert bool(solid.notes) == bool(note)
            assert note in "".join(solid.notes)


REFUSED = [
    *(
        ((DATA / name).read_bytes(), code, words)
        for name, code, words in (
            ("d09_unknown_required.glb", "unsupported", "XYZ_some_geometry"),
            ("h06_prob_uint8.npy", "not-voxels", "grid > 0.5"),
            ("k10_angles_rad.json", "radians", "look like radians"),
        )
    ),
    *(
        (f"{header}\n0,0,0\n1,0,0\n1,1,0\n".encode(), "bad-header", "")
        for header in ("x,y,height", "layer,row,column", "height,width,depth", "x,-y,z", "x,x,y,z")
    ),
    (b"x y z\n0 0 0 9\n1 0 0\n2 0 0\n", "wrong-count", ""),
    # Other kinds of files, and models of other programs.
    (b"%PDF-1.7\n", "wrong-kind", "a PDF document"),
    (b"<!doctype html><html>", "wrong-kind", "an HTML page"),
    (b"Dear reader,\nthis is a letter.", "wrong-kind", "Dear reader"),
    (bytes(range(256)), "wrong-kind", "a binary file"),
    (b"0 0 0\n1 0 \x000\n", "wrong-kind", "a zero byte"),
    (b"Kaydara FBX Binary  \0\x1a\0", "wrong-kind", "an FBX scene"),
    (b"  0\r\nSECTION\r\n  2\r\nHEADER\r\n", "wrong-kind", "a DXF drawing"),
    (b"#VRML V2.0 utf8\nShape { point [0 0 0, 1 0 0] }", "wrong-kind", "a VRML scene"),
    (b"<?xml version='1.0'?>\n<COLLADA version='1.4'/>", "wrong-kind", "a COLLADA scene"),
    (b" " * 72 + b"S      1\n1H,,1H;,4HSLOT;", "wrong-kind", "an IGES model"),
    (zipped(**{"cells.npy": npy(STAIRS)}), "", "numpy.save"),
    # Features of the formats that are not supported.
    (b"4OFF\n4 4 6\n", "unsupported", ""),
    (b"nOFF\n3\n4 4 6\n", "unsupported", ""),
    (L_OBJ + b"surf 0 1 0 1 1 2 3 4\n", "unsupported", "surf"),
    (L_OBJ + b"curv 0 1 1 2\n", "unsupported", "curv"),
    (scene(lambda d: d.update(scene=-1)), "damaged", "scene -1, but its last scene is 0"),
    (scene(lambda d: d["asset"].update(minVersion="2.1")), "wrong-version", "version 2.1"),
    (scene(lambda d: d["accessors"][1].pop("bufferView")), "unsupported", "compression"),
    (
        archive(mesh_xml(2, 3, 4), 1, required=f'xmlns:q="{CORE}x" requiredextensions="q"'),
        "unsupported",
        "core/2015/02x",
    ),
    (npy(np.full((2, 2, 2), np.nan)), "not-voxels", ""),
    # Files with too little information.
    (b"0, 90, -90.0, 180, 0, 90", "digits", ""),
    (TETRAHEDRON + b"f 1 2 x\n", "damaged", ""),
]


@pytest.mark.parametrize(("data", "code", "words"), REFUSED)
def test_ambiguous_and_unsupported_files_are_refused_by_name(
    data: bytes, code: str, words: str
) -> None:
    refusal = refusal_of(data)
    assert code in ("", refusal.code)
    assert words in refusal.detail
    assert code != "wrong-kind" or "foldback-path/1" in refusal.detail


ONE_CELL = vox_model(np.array([[0, 0, 0]]))
ONE_IN_SCENE = (vox_transform(0, 1), vox_shape(1, 0))
COLOURLESS = chunk(b"SIZE", struct.pack("<3I", 2, 1, 1)) + chunk(
    b"XYZI", struct.pack("<I", 2) + bytes([0, 0, 0, 1, 1, 0, 0, 0])
)


def test_read_vox_notes_ignored_parts() -> None:
    for chunks, note in (
        ((ONE_CELL, vox_model(np.array([[2, 0, 0]])), *ONE_IN_SCENE), "outside of the scene"),
        ((COLOURLESS,), "colour 0"),
        ((COLOURLESS, *ONE_IN_SCENE), "colour 0"),
    ):
        with case((chunks, note)):
            shape = shape_in(vox_file(*chunks))
            assert len(shape) == 1
            assert note in "".join(shape.notes)


def frames(*numbers: int) -> bytes:
    """Return the count of some frames and their states, each moved by its own number."""
    states = (words(_f=str(number), _t=f"{number} 0 0") for number in numbers)
    return struct.pack("<I", len(numbers)) + b"".join(states)


def test_read_vox_of_moving_objects_takes_the_earliest_frame() -> None:
    numbers = (7, 3, 5)
    group = struct.pack("<I", 1) + words() + struct.pack("<3I", 2, 2, 3)
    moving = struct.pack("<I", 2) + words() + struct.pack("<3i", 4, -1, -1) + frames(*numbers)
    models = b"".join(struct.pack("<I", 0) + words(_f=str(number)) for number in numbers)
    moved = struct.pack("<I", 4) + words() + struct.pack("<I", len(numbers)) + models
    scene = (
        *(vox_transform(0, 1), chunk(b"nGRP", group), chunk(b"nTRN", moving)),
        *(vox_transform(3, 5, _t="0 1 0"), chunk(b"nSHP", moved), vox_shape(5, 0)),
    )
    shape = shape_in(vox_file(ONE_CELL, *scene))
    assert np.ptp(shape.cells, axis=0).tolist() == [min(numbers), 1, 0]
    assert "first frame" in "".join(shape.notes)
