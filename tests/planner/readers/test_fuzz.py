import random
import struct
from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np
import pytest
import trimesh

from foldback.planner.chain.path import Path
from foldback.planner.errors import InputError
from foldback.planner.plan.shape_writers import write_chain, write_path, write_shape
from foldback.planner.readers import read
from foldback.planner.readers.formats import READABLE_SUFFIXES
from foldback.planner.shapes.shape import Shape
from foldback.planner.shapes.solid import Solid
from foldback.planner.silhouettes.picture import Picture
from foldback.planner.silhouettes.word import Word
from tests.planner.chains import chain_of
from tests.planner.silhouettes.pictures import as_picture, ring
from tests.planner.solids_made import MESH_KINDS, as_binvox, as_grid, as_vox, exported

CELLS = np.argwhere(np.ones((2, 3, 2)))
WALK = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (2, 1, 1), (2, 2, 1)]
MESH = trimesh.creation.icosphere(subdivisions=1)
FILES = {
    **{f"{kind}.{kind.partition('_')[0]}": exported(kind, MESH) for kind in MESH_KINDS},
    "voxels.vox": as_vox(CELLS),
    "voxels.binvox": as_binvox(CELLS),
    "voxels.npy": as_grid(CELLS),
    "voxels.json": write_shape(Shape.from_cells(CELLS)),
    "path.json": write_path(Path.from_cells(WALK, name="some path")),
    "chain.json": write_chain(chain_of(WALK)),
    "cells.csv": b"x,y,z\n" + b"".join(b"%d,%d,%d\n" % cell for cell in WALK),
    "cells.xyz": b"6\na chain of carbon\n"
    + b"".join(b"C %d.0 %d.0 %d.0\n" % cell for cell in WALK),
    "angles.txt": b"0 - + 0 - +",
    "word.txt": b"word: Gr\xc3\xb6\xc3\x9fe",
    "ring.svg": b'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">'
    b'<path d="M1 1h7v7h-7zM3 3v3h3v-3z" fill="#c00" style="stroke:url(#a)"/></svg>',
    "ring.png": as_picture(ring(24)),
    "ring.jpg": as_picture(ring(24), "JPEG"),
    "ring.jpeg": as_picture(ring(24), "JPEG"),
}
"""A small valid file of each format, by its name."""
TEXT_SUFFIXES = (".svg", ".json", ".csv", ".xyz", ".txt")
TEXT_SPICE = (
    *(b"[", b"]", b"{", b"}", b",", b'"', b"\n", b"\\", b"\x00", b"\xff", b"-", b".", b"e", b"9"),
    *(b"NaN", b"1e999", b"null", b"true", b"[[", b"\r", b"#", b"\xef\xbb\xbf", b" ", b"\\ud800"),
)
SPICE = (
    *(b"\x00", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f"),
    *(b"-1", b"99999999999999", b"1e999", b"nan", b"\n", b" ", b"#", b'"', b"[", b"{", b"/"),
    struct.pack("<d", float("nan")),
    struct.pack("<I", 1 << 30),
)


def mutate(data: bytes, rng: random.Random, spice: Sequence[bytes]) -> bytes:
    """Return a copy with a few bytes changed, removed, doubled, inserted or overwritten."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        # Half of the changes are in the header, where wrong values have the largest effect.
        reach = len(changed) if rng.random() < 0.5 else min(len(changed), 400)
        at = rng.randrange(reach + 1)
        match rng.randrange(6):
            case 0 if rng.random() < 0.3:
                del changed[at:]
            case 1:
                del changed[at : at + rng.randint(1, 8)]
            case 2:
                changed[at:at] = rng.choice(spice)
            case 3:
                changed[at:at] = changed[at : at + rng.randint(1, 60)]
            case 4:
                written = rng.choice(spice)
                changed[at : at + len(written)] = written
            case _:
                changed[at : at + 1] = bytes([rng.randrange(256)])
    return bytes(changed)


def test_files_of_each_readable_suffix_are_mutated() -> None:
    assert {FilePath(name).suffix for name in FILES} == {*READABLE_SUFFIXES}


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_mutated_files_are_read_or_refused(name: str) -> None:
    rng, spice = random.Random(name), TEXT_SPICE if name.endswith(TEXT_SUFFIXES) else SPICE
    outcomes: dict[str, int] = {}
    for _ in range(200):
        data = mutate(FILES[name], rng, spice)
        try:
            read_shape = read(data, filename=name)
        except InputError as refusal:
            outcomes[refusal.code] = outcomes.get(refusal.code, 0) + 1
            assert str(refusal).isprintable(), data
            assert refusal.detail.endswith("."), refusal.detail
        else:
            outcomes["read"] = outcomes.get("read", 0) + 1
            assert isinstance(read_shape, Word | Picture) or len(read_shape) >= 1
            if isinstance(read_shape, Solid):
                assert np.isfinite(read_shape.vertices).all()
                assert read_shape.faces.min() >= 0
                assert read_shape.faces.max() < len(read_shape.vertices)
    assert len(outcomes) >= 2, outcomes


def test_noise_after_a_signature_is_refused() -> None:
    rng = random.Random(1)
    texts = (b"", b"ply\n", b"OFF\n", b"#binvox", b"solid facet", b"v 0 0 0\nf ")
    for signature in (*texts, b"glTF", b"VOX ", b"PK\x03\x04"):
        for _ in range(100):
            with pytest.raises(InputError):
                read(signature + rng.randbytes(100), filename="a.stl")
