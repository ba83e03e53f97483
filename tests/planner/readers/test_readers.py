import json
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.display_names import MAX_NAME_LENGTH
from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.plan.shape_writers import write_chain, write_path
from foldback.planner.readers import read
from foldback.planner.readers.angle_strings import read_angle_string
from tests.case import case
from tests.conftest import examples
from tests.planner.chains import chain_of
from tests.planner.lattice import Ints, walks
from tests.planner.reading import cells_of, refusal_of
from tests.planner.solids_made import npy

CELLS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1]]
MAX_REFUSAL_CHARS = 300
"""Length up to which people read a refusal; it never repeats a whole file."""


def as_json(cells: Ints) -> bytes:
    return json.dumps(cells.tolist()).encode()


def as_csv(cells: Ints) -> bytes:
    return b"x,y,z\n" + b"".join(b"%d,%d,%d\n" % tuple(c) for c in cells)


def as_xyz(cells: Ints) -> bytes:
    return b"".join(b"%d %d %d\n" % tuple(c) for c in cells)


def as_chemists_xyz(cells: Ints) -> bytes:
    head = b"%d\na chain of carbon\n" % len(cells)
    return head + b"".join(b"C %d.0 %d.0 %d.0\n" % tuple(c) for c in cells)


def as_path(cells: Ints) -> bytes:
    return write_path(Path.from_cells(cells, name="some path"), title="A title")


def as_chain(cells: Ints) -> bytes:
    return write_chain(chain_of(cells))


PATH_WRITERS = (as_json, as_csv, as_xyz, as_chemists_xyz, npy, as_path)
Writer = Callable[[Ints], bytes]


# Valid input --------------------------------------------------------------------------------------


@pytest.mark.parametrize("writer", PATH_WRITERS)
@given(cells=walks())
def test_cells_are_read_back_in_every_format(writer: Writer, cells: Ints) -> None:
    assert cells_of(writer(cells)) == cells.tolist()


@given(walks(), st.text(max_size=200), st.floats(1e-6, 1e3))
@examples(one_of=2)
def test_written_path_is_read_back(cells: Ints, name: str, pitch_m: float) -> None:
    path = Path.from_cells(cells, name=name, pitch_m=pitch_m)
    shape_again = read(write_path(path))
    assert isinstance(shape_again, Path)
    np.testing.assert_array_equal(shape_again.cells, cells)
    assert shape_again.pitch_m == pitch_m
    path_again = read(write_path(shape_again))
    assert path_again.name == shape_again.name
    assert len(shape_again.name) <= MAX_NAME_LENGTH
    assert shape_again.name.isprintable()


@given(walks())
def test_written_chain_of_a_path_is_read_back_exactly(cells: Ints) -> None:
    chain = Chain.from_path(Path.from_cells(cells, name="a chain", pitch_m=0.03))
    shape_again = read(write_chain(chain))
    assert isinstance(shape_again, Chain)
    np.testing.assert_array_equal(shape_again.folded_rad, chain.folded_rad)
    np.testing.assert_allclose(shape_again.folded_poses.positions, cells, atol=1e-9)
    assert (shape_again.name, shape_again.module, shape_again.pitch_m) == ("a chain", CUBE, 0.03)


def test_variants_of_lists_of_cells_are_read() -> None:
    for data in (
        b"0;0;0\r\n1;0;0\r\n1;1;0\r\n1;1;1\r\n",
        b"0\t0\t0\n1\t0\t0\n1\t1\t0\n1\t1\t1",
        b"# a comment\n\n0, 0, 0,\n1, 0, 0,\n1, 1, 0,\n1, 1, 1,\n",
        b'"0","0","0"\n"1","0","0"\n"1","1","0"\n"1","1","1"\n',
        b"index,z,y,x\n0,0,0,0\n1,0,0,1\n2,0,1,1\n3,1,1,1\n",
        b"a,b,c\n0,0,0\n1,0,0\n1,1,0\n1,1,1\n",
        b"# x y z\n 0 0 0\n1e0 0.0 -0\n+1 1. 0\n1 1 1\n\n",
        b"4\n\n0 0 0\n1 0 0\n1 1 0\n1 1 1\n",
        b'{"cells": [[0,0,0],[1,0,0],[1,1,0],[1,1,1]], "format": "foldback-path/1", "by": {}}',
        npy(np.asfortranarray(np.array(CELLS, dtype=">i2"))),
        npy(np.array(CELLS, dtype=np.float16)),
    ):
        with case(data):
            assert cells_of(data) == CELLS


def test_shape_is_named_by_its_content_or_its_file() -> None:
    for filename, name in (
        ("my wrench.csv", "my wrench"),
        ("../../etc/pass\x00wd\n.csv", "passwd"),
        ("C:\\shapes\\a.b.csv", "a.b"),
        (".csv", ".csv"),
        (None, "path"),
        ("\u202etxt.csv", "txt"),
        ("w" * 500 + ".csv", "w" * (MAX_NAME_LENGTH - 1) + "…"),
    ):
        assert read(as_csv(np.array(CELLS)), filename=filename).name == name
    assert read(as_path(np.array(CELLS)), filename="other.json").name == "some path"


# Refused input ------------------------------------------------------------------------------------


def path_document(**changes: object) -> bytes:
    document = {"format": "foldback-path/1", "name": "n", "pitch_m": 0.01, "cells": CELLS}
    document.update(changes)
    return json.dumps({k: v for k, v in document.items() if v is not ...}).encode()


def chain_document(**changes: object) -> bytes:
    document = {"format": "foldback-chain/1", "module": "cube", "joint_angles_deg": [[90, 0]]}
    return path_document(**{"name": ..., "pitch_m": ..., "cells": ..., **document, **changes})


def tetrahedra_document(**changes: object) -> bytes:
    return chain_document(**{"module": "tetrahedron", "joint_angles_deg": [0, 90], **changes})


def test_bad_input_is_refused_with_its_place() -> None:
    for data, code, error_place in (
        (b"", "empty", None),
        (b" \n\t ", "empty", None),
        (b"[]", "empty", "the list"),
        # Cells that form no path.
        (b"0 0 0\n1 0 0\n1 .5 0", "not-whole", "line 3"),
        (b"[[0,0,0],[1,0,NaN],[1,1,0]]", "not-finite", "cell 1"),
        (b"[[0,0,0],[1,0,0],[1,%s,0]]" % (b"9" * 9999), "too-far", "cell 2"),
        (b"0 0 0\n%s 0 0" % (b"9" * 9999), "too-far", "line 2"),
        (b"[[0,0,0],[1,0,0],[1,1,true]]", "not-a-number", "cell 2"),
        (b'[[0,0,0],[1,0,0],[1,1,"1"]]', "not-a-number", "cell 2"),
        (b"0,0,0\n1,,0\n", "not-a-number", "line 2"),
        ("0 0 0\n١ 0 0\n".encode(), "not-a-number", "line 2"),
        # Rows of the wrong length.
        (b"[[0,0,0],[1,0],[1,1,0]]", "wrong-count", "cell 1"),
        (b"0 0 0\n1 0 0 0\n", "wrong-count", "line 2"),
        (b"9\n\n0 0 0\n1 0 0\n", "truncated", "line 1"),
        (b"2\n\n0 0 0\n1 0 0\n1 1 0\n", "wrong-count", "line 1"),
        # Invalid JSON, or JSON of another program.
        (b"[[0,0,0],[1,0,0],[1,", "truncated", "line 1, column 21"),
        (b"[[0,0,0],[1,0,0],[1 1 0]]", "bad-json", "line 1, column 21"),
        (b"[" * 100_000, "too-deep", None),
        (b'{"format":"foldback-path/1","cells":[],"cells":[]}', "duplicate-key", "key 'cells'"),
        (b"{}", "no-format", None),
        (path_document(format="foldback-path/2"), "wrong-version", "format"),
        (path_document(format="foldback-plan/1"), "wrong-format", "format"),
        (path_document(format=["foldback-path/1"]), "wrong-format", "format"),
        (path_document(name=7), "wrong-type", "name"),
        (path_document(pitch_m="1 cm"), "wrong-type", "pitch_m"),
        (path_document(pitch_m=10**400), "bad-pitch", None),
        # Chains.
        (chain_document(module="sphere"), "unknown-module", None),
        (chain_document(module=3), "wrong-type", "module"),
        (chain_document(joint_angles_deg=...), "wrong-type", "joint_angles_deg"),
        (chain_document(joint_angles_deg=[[0, 0], [0]]), "wrong-count", "joint 1"),
        (chain_document(joint_angles_deg=[[0, "0"]]), "not-a-number", "joint 0"),
        (chain_document(joint_angles_deg=[[0, float("nan")]]), "not-finite", "angle 1"),
        (chain_document(joint_angles_deg=[[90, 0]] * 4), "overlap", "modules 0 and 4"),
        (tetrahedra_document(first_wxyz=[0, 0, 0, 0]), "bad-orientation", None),
        (tetrahedra_document(first_wxyz=[1, 0, 0]), "wrong-type", "first_wxyz"),
        (tetrahedra_document(first_position=["a", 0, 0]), "wrong-type", "first_position"),
        (tetrahedra_document(joint_angles_deg=[0, 91.5]), "out-of-range", "joint 1"),
        (tetrahedra_document(joint_angles_deg=[[0, 90], 0]), "wrong-count", "joint 0"),
        # Arrays.
        (npy(np.zeros((5, 2))), "wrong-shape", None),
        (npy(np.zeros((4, 4, 4), dtype=bool)), "empty", None),
        (npy(np.zeros((4, 3), dtype=complex)), "wrong-type", None),
        (npy(np.array([{"a": 1}], dtype=object)), "wrong-type", None),
        (npy(np.array(CELLS))[:-5], "truncated", None),
        (npy(np.array(CELLS)) + b"\0", "damaged", None),
        (b"\x93NUMPY\x09\x00", "damaged", "header"),
    ):
        with case((data, code)):
            refusal = refusal_of(data)
            assert (refusal.code, refusal.where) == (code, error_place)
            assert len(str(refusal)) <= MAX_REFUSAL_CHARS


def test_header_of_a_huge_array_is_refused_before_it_is_made() -> None:
    data = npy(np.array(CELLS))
    assert refusal_of(data.replace(b"(4, 3), }", b"(10**12)")).code == "damaged"
    huge = data.replace(b"(4, 3), }     ", b"(99999999, 3),}")[: len(data)]
    assert refusal_of(huge).code == "truncated"


@pytest.mark.parametrize("writer", (*PATH_WRITERS, as_chain))
def test_more_cells_than_the_limit_are_refused(writer: Writer) -> None:
    line = np.zeros((40, 3), dtype=np.int64)
    line[:, 0] = np.arange(40)
    assert len(read(writer(line), max_cells=40)) == 40
    assert refusal_of(writer(line), max_cells=39).code == "too-many-cells"


@pytest.mark.parametrize("data", [b"0 0 0\n" * 40_000, b"[" + b"0," * 60_000, b"[]," * 60_000])
def test_large_data_is_refused_before_it_is_parsed(data: bytes) -> None:
    assert refusal_of(b"[" + data, max_cells=100).code in ("too-large", "too-many-cells")


# Angle strings ------------------------------------------------------------------------------------


RING = "- - - + - - - + - - -"


@pytest.mark.parametrize(
    "text", [RING, RING.replace(" ", ""), RING.replace(" ", ",\n"), RING.replace("-", "\u2212")]
)
def test_ring_is_read_from_its_signs(text: str) -> None:
    chain = read_angle_string(text)
    assert len(chain) == 12
    assert chain.module is TETRAHEDRON
    np.testing.assert_allclose(
        np.rad2deg(chain.folded_rad), [-90.0, -90, -90, 90, -90, -90, -90, 90, -90, -90, -90]
    )


def test_file_of_signs_is_a_chain() -> None:
    chain = read(b"0 - - - +\n0 -\n", filename="snake.txt")
    assert isinstance(chain, Chain)
    assert chain.name == "snake"
    turns = [0.0, -90, -90, -90, 90, 0, -90]
    np.testing.assert_allclose(np.rad2deg(chain.folded_rad), turns)


@pytest.mark.parametrize("text", [b"0 0 0\n0 0 -1\n", b"0,0,0\n0,0,1\n0,1,1\n", b"0 0 0\n"])
def test_tables_of_cells_are_no_angle_strings(text: bytes) -> None:
    try:
        assert not isinstance(read(text), Chain)
    except InputError as error:
        assert error.code != "stray-character"


def test_bad_strings_are_refused_with_their_place() -> None:
    for text, code, error_place in (
        ("0 - x +", "stray-character", "character 5"),
        ("", "wrong-count", None),
        ("- - - + - - - + - - - +", "overlap", "modules 0 and 12"),
    ):
        with case((text, code)):
            with pytest.raises(InputError) as refusal:
                read_angle_string(text)
            assert refusal.value.code == code
            assert (refusal.value.where or "").startswith(error_place or "")
