"""What readers accept although other programs write it oddly, and what they refuse early."""

import json
import struct
import tracemalloc
from typing import Any

import numpy as np
import pytest

from foldback.planner.errors import InputError
from foldback.planner.readers import formats, read
from foldback.planner.shapes.solid import signed_volume
from tests.planner.reading import cells_of, refusal_of, shape_in, solid_in
from tests.planner.solids_made import (
    as_vox,
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
)

BOX = box(2, 3, 4)
SHORT = "with fewer than 3 corners"
ODD_TEXT = "全体 Åse \x85 \x0b \x0c \x1c \x1d \x1e \u2028 \u2029".encode()
"""Characters at which Python, but no file format, ends a line."""
CELLS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]]
ROWS = b"0 0 0\n1 0 0\n1 1 0\n1 1 1\n"


def off(keyword: bytes, separator: bytes, *, extra: bytes = b"", polygons: int = 12) -> bytes:
    """Return the box in OFF, its counts after the keyword and a separator."""
    lines = exported("off", BOX).split(b"\n", 2)[2].split(b"\n")
    data = [line for line in lines if line.strip()]
    return (
        keyword + separator + b"8 %d 0\n" % polygons + b"\n".join(data[:20]) + b"\n" + extra + b"\n"
    )


def volume_in(data: bytes, filename: str | None = None) -> float:
    solid = solid_in(data, filename)
    return signed_volume(solid.vertices, solid.faces)


@pytest.mark.parametrize(
    "head",
    [(b"OFF", b""), (b"OFF", b" "), (b"OFF", b"\n# x\n\n"), (b"COFF", b""), (b"NOFF", b"\t")],
)
def test_off_counts_may_follow_the_keyword_at_once(head: tuple[bytes, bytes]) -> None:
    assert volume_in(off(*head)) == pytest.approx(24)


def test_off_variants_with_glued_counts_are_named() -> None:
    assert "4OFF" in refusal_of(off(b"4OFF", b"")).detail


def test_line_numbers_of_off_files_count_glued_and_blank_lines() -> None:
    for separator in (b"", b"\n\n"):
        data = off(b"OFF", separator).replace(b"\n3 ", b"\n\n3 x ", 1)
        line = data[: data.index(b"3 x")].count(b"\n") + 1
        assert refusal_of(data).where == f"line {line}"


@pytest.mark.parametrize("corners", [1, 2])
def test_polygons_of_one_or_two_corners_are_skipped_with_a_note(corners: int) -> None:
    numbers = b" ".join(b"%d" % (n + 1) for n in range(corners))
    obj = exported("obj", BOX) + b"\nf " + numbers + b"\nf -1\n"
    ply = exported("ply_ascii", BOX).replace(b"face 12", b"face 13") + b"%d %b\n" % (
        corners,
        numbers,
    )
    off_file = off(b"OFF", b"\n", extra=b"%d %b" % (corners, numbers), polygons=13)
    for data, count in ((obj, 2), (ply, 1), (off_file, 1)):
        assert volume_in(data) == pytest.approx(24)
        (note,) = solid_in(data).notes
        assert note.startswith(f"{count} polygon")
        assert SHORT in note


def test_obj_of_short_polygons_alone_has_no_triangles() -> None:
    refusal = refusal_of(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nf 3\n")
    assert refusal.code == "no-triangles"


def test_comments_and_names_may_hold_any_bytes() -> None:
    for odd in (ODD_TEXT, b"\xff\xfe \x0b \x0c", b"\x85\xe9"):
        ply = exported("ply_ascii", BOX)
        assert volume_in(ply.replace(b"\n", b"\ncomment TextureFile " + odd + b"\n", 1)) > 23
        crlf = ply.replace(b"\n", b"\r\n").replace(b"\r\n", b"\r\ncomment " + odd + b"\r\n", 1)
        assert volume_in(crlf) == pytest.approx(24)
        assert volume_in(exported("obj", BOX) + b"\no " + odd + b"\n# " + odd) > 23
        assert volume_in(off(b"OFF", b" # " + odd + b"\n")) == pytest.approx(24)
        stl = exported("stl_ascii", BOX).replace(b"solid ", b"solid " + odd + b" ", 1)
        assert volume_in(stl) == pytest.approx(24)
        assert cells_of(b"# " + odd + b"\n" + ROWS) == CELLS
        csv = ROWS.replace(b" ", b",")
        assert cells_of(b"# " + odd + b"\n" + csv) == CELLS
        assert cells_of(b"4\n" + odd + b"\n" + ROWS) == CELLS


def test_lines_may_end_with_carriage_returns_alone() -> None:
    for data in (ROWS, ROWS.replace(b" ", b","), json.dumps(CELLS, indent=1).encode()):
        assert cells_of(data.replace(b"\n", b"\r")) == CELLS
    assert refusal_of(ROWS.replace(b"1 1 1", b"1 x 1").replace(b"\n", b"\r")).where == "line 4"


@pytest.mark.parametrize("tail", [b"\n", b"\r\n", b"\n\n", b"\x1a"])
def test_line_ends_after_the_data_mean_nothing(tail: bytes) -> None:
    binvox = b"#binvox 1\ndim 2 2 2\ndata\n\x01\x08" + tail
    assert len(shape_in(binvox)) == 8
    assert len(shape_in(as_vox(np.array(CELLS)) + tail)) == 4
    assert volume_in(exported("ply", BOX) + tail) == pytest.approx(24)
    assert volume_in(exported("stl", BOX) + tail, "a.stl") == pytest.approx(24)
    assert volume_in(exported("glb", BOX) + tail) == pytest.approx(24)
    assert cells_of(json.dumps(CELLS).encode() + tail) == CELLS
    if tail.strip() == b"":
        assert cells_of(npy(np.array(CELLS)) + tail) == CELLS


def npy_header(header: str) -> bytes:
    text = header.encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


@pytest.mark.parametrize(
    ("shape", "quoted"),
    [
        ((1, 2, 2, 2), "array[0]"),
        ((2, 2, 2, 1), "array[..., 0]"),
        ((1, 1, 2, 2, 2), "batch"),
        ((2, 2, 2, 2), "4 axes"),
    ],
)
def test_arrays_with_a_batch_axis_are_refused_with_the_remedy(
    shape: tuple[int, ...], quoted: str
) -> None:
    refusal = refusal_of(npy(np.ones(shape, dtype=np.uint8)))
    assert refusal.code == "wrong-shape"
    assert quoted in refusal.detail


@pytest.mark.parametrize(
    "shape",
    [
        (2**62, 0, 2**62),
        (0, 10**18),
        (10**30, 3),
        (-1, 3),
        (0, 3),
        (2**63, 2**63, 2),
        (0, 0, 0),
        (),
        (1,) * 2000,
    ],
    ids=str,
)
def test_arrays_of_impossible_shapes_are_refused_in_words(shape: tuple[int, ...]) -> None:
    for kind in ("<i4", "|b1", "<f8"):
        header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape!r}, }}"
        refusal = refusal_of(npy_header(header))
        assert refusal.code != "unreadable"


def test_scenes_are_read_without_their_pictures() -> None:
    outside = {"uri": "textures/wood.png"}
    text = scene(lambda d: d.update(images=[outside], textures=[{"source": 0}]))
    assert volume_in(text) == pytest.approx(24)
    unused = {"uri": "animation.bin", "byteLength": 4}
    assert volume_in(scene(lambda d: d["buffers"].append(unused))) == pytest.approx(24)


def compressed(extension: str) -> bytes:
    """Return a scene of which an extension compresses the geometry, without requiring it."""

    def edit(document: dict[str, Any]) -> None:
        document["extensionsUsed"] = [extension]
        if "draco" in extension:
            primitive = document["meshes"][0]["primitives"][0]
            primitive["extensions"] = {extension: {"bufferView": 0}}
            for accessor in document["accessors"]:
                del accessor["bufferView"]
        else:
            for view in document["bufferViews"]:
                view["extensions"] = {extension: {"buffer": 0}}
            for buffer in document["buffers"]:
                del buffer["uri"]
                buffer["extensions"] = {extension: {"fallback": True}}

    return scene(edit)


@pytest.mark.parametrize(
    ("extension", "name"),
    [("KHR_draco_mesh_compression", "Draco"), ("EXT_meshopt_compression", "meshopt")],
)
def test_compressed_geometry_is_named(extension: str, name: str) -> None:
    refusal = refusal_of(compressed(extension))
    assert refusal.code == "unsupported"
    assert name in refusal.detail
    assert extension in refusal.detail


def test_counts_that_a_file_cannot_hold_are_not_answered_with_simplify() -> None:
    stl = exported("stl", BOX)
    ply = exported("ply_ascii", BOX)
    binary = exported("ply", BOX)

    def many(document: dict[str, Any]) -> None:
        for accessor in document["accessors"]:
            accessor["count"] = 3_000_000_000

    for data in (
        stl[:80] + struct.pack("<I", 4_000_000_000) + stl[84:],
        ply.replace(b"face 12", b"face 4000000000"),
        ply.replace(b"vertex 8", b"vertex 4000000000"),
        binary.replace(b"face 12", b"face 4000000000"),
        off(b"OFF", b"\n", polygons=4_000_000_000),
        scene(many),
        b"#binvox 1\ndim 4096 4096 4096\ndata\n\x01\x08",
        b"3000000000\n\n" + ROWS,
        npy_header("{'descr': '<i4', 'fortran_order': False, 'shape': (150000, 3), }"),
        npy_header(f"{{'descr': '<i4', 'fortran_order': False, 'shape': ({10**30}, 3), }}"),
    ):
        refusal = refusal_of(data, filename="a.stl")
        assert refusal.code in ("truncated", "damaged"), data[:60]
        assert "simplify" not in refusal.detail


@pytest.mark.parametrize(
    ("data", "quoted"),
    [
        (b'[["0","0","0"],["1","0","0"],["1","1","0"]]', 'the text "0"'),
        (b"[[true,0,0],[1,0,0],[1,1,0]]", "got true"),
        (b"[[null,0,0],[1,0,0],[1,1,0]]", "got null"),
        (
            b'{"format":"foldback-chain/1","module":"tetrahedron","joint_angles_deg":["90"]}',
            'the text "90"',
        ),
        (b'{"format":"foldback-path/1","pitch_m":"0.1","cells":[[0,0,0]]}', 'the text "0.1"'),
    ],
)
def test_json_values_are_quoted_as_they_stand_in_the_file(data: bytes, quoted: str) -> None:
    assert quoted in str(refusal_of(data))


@pytest.mark.parametrize(
    ("data", "quoted"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 1\n", "git lfs pull"),
        (b"/annex/objects/SHA256E-s1--0.stl\n", "git annex get"),
        (b"<!DOCTYPE html>\n<html><body>404</body></html>", "HTML page"),
        (b"\n<!doctype HTML><title>Sign in</title>", "HTML page"),
    ],
)
def test_files_that_stand_for_another_file_are_named(data: bytes, quoted: str) -> None:
    assert quoted in refusal_of(data, filename="model.stl").detail


def vox_group(node: int, children: list[int]) -> bytes:
    """Return a scene node of several others."""
    return chunk(
        b"nGRP",
        struct.pack("<I", node)
        + words()
        + struct.pack(f"<{len(children) + 1}I", len(children), *children),
    )


def test_shared_nodes_of_a_vox_scene_are_read_each_time() -> None:
    cube = vox_model(np.array([[0, 0, 0]]))
    scene_nodes = (
        vox_transform(0, 1),
        vox_group(1, [2, 4]),
        vox_transform(2, 6, _t="0 0 0"),
        vox_transform(4, 6, _t="1 0 0"),
        vox_shape(6, 0),
    )
    assert shape_in(vox_file(cube, *scene_nodes)).cells.tolist() == [[0, 0, 0], [1, 0, 0]]


def test_vox_scenes_that_contain_themselves_or_grow_without_end_are_refused() -> None:
    cube = vox_model(np.array([[0, 0, 0]]))
    loop = vox_file(cube, vox_transform(0, 1), vox_group(1, [0]))
    assert "contains itself" in refusal_of(loop).detail
    doubling = [
        node
        for k in range(25)
        for node in (vox_transform(2 * k, 2 * k + 1), vox_group(2 * k + 1, [2 * k + 2] * 2))
    ]
    grown = vox_file(cube, *doubling, vox_transform(50, 51), vox_shape(51, 0))
    assert refusal_of(grown).code == "too-large"


@pytest.mark.parametrize(
    "data",
    [
        b"\n" * (6 << 20) + b"1 2 3\n",
        b" \n" * (3 << 20) + b"1 2 3\n",
        b"\r" * (6 << 20) + b"1 2 3\n",
        b"1\n" * (3 << 20),
        b"OFF\n" + b"\n" * (6 << 20),
        b"# \n" * (1 << 20),
        b"OFF\n1 1 0\n" + b" \n" * (6 << 20),
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nelement face 1\n"
        b"property list uchar int vertex_index\nend_header\n" + b"\n" * (6 << 20),
        b"v 0 0 0\n" + b"\n" * (6 << 20) + b"f 1\n",
        b"solid a\nfacet\n" + b"\n" * (6 << 20) + b"endsolid\n",
        b"," * (3 << 20),
        b"x,y,z" + b",a" * (1 << 20) + b"\n1,2,3\n",
    ],
    ids=[
        *("line ends", "blank lines", "carriage returns", "lines of one digit", "OFF"),
        *("comments", "OFF body"),
        *("PLY", "OBJ", "STL", "commas", "columns"),
    ],
)
def test_lines_of_nothing_take_no_memory(data: bytes) -> None:
    tracemalloc.start()
    try:
        refusal = refusal_of(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert refusal.code != "unreadable"
    assert peak < 12 * len(data)


def test_unforeseen_faults_of_readers_become_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(data: bytes) -> bool:
        raise ZeroDivisionError("internal words")

    monkeypatch.setattr(formats, "is_obj", fail)
    with pytest.raises(InputError) as refusal:
        read(b"1 2 3\n")
    assert refusal.value.code == "unreadable"
    assert str(refusal.value) == formats.UNREADABLE
    assert isinstance(refusal.value.__cause__, ZeroDivisionError)
