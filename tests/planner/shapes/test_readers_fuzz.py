from __future__ import annotations

import random
import struct
from collections.abc import Callable, Sequence

import numpy as np
import pytest
import trimesh

from planner.errors import InputError
from planner.plan.shape_files import write_shape
from planner.readers import read
from planner.shapes.shape import Shape
from planner.shapes.solid import Solid
from planner.shapes.voxelise import voxelise
from tests.planner.solids_made import MESH_KINDS, as_binvox, as_grid, as_vox, exported

CELLS = np.argwhere(np.ones((2, 3, 2)))
FILES = {
    **{kind: exported(kind, trimesh.creation.icosphere(subdivisions=1)) for kind in MESH_KINDS},
    "vox": as_vox(CELLS),
    "binvox": as_binvox(CELLS),
    "npy": as_grid(CELLS),
    "json": write_shape(Shape.from_cells(CELLS)),
}
SPICE = (
    *(b"\x00", b"\xff\xff\xff\xff", b"\xff\xff\xff\x7f", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f"),
    *(b"-1", b"99999999999999", b"1e999", b"nan", b"\n", b" ", b"#", b'"', b"[", b"{", b"/"),
    struct.pack("<d", float("nan")),
    struct.pack("<I", 1 << 30),
)


def mutated(data: bytes, rng: random.Random, spice: Sequence[bytes]) -> bytes:
    """A copy with a few bytes changed, cut, doubled, put in or written over."""
    changed = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        # Headers are where lies do harm: half of the changes go there.
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


@pytest.mark.slow
@pytest.mark.parametrize("kind", FILES)
def test_thousands_of_mutated_files_are_read_or_refused(kind: str) -> None:
    rng = random.Random(kind)
    outcomes: dict[str, int] = {}
    for _ in range(500):
        data = mutated(FILES[kind], rng, SPICE)
        try:
            found = read(data, filename=f"a.{kind.partition('_')[0]}")
        except InputError as refusal:
            outcomes[refusal.code] = outcomes.get(refusal.code, 0) + 1
            assert str(refusal).isprintable(), data
            assert refusal.detail.endswith("."), refusal.detail
        else:
            outcomes["read"] = outcomes.get("read", 0) + 1
            assert len(found) >= 1
            if isinstance(found, Solid):
                assert np.isfinite(found.vertices).all()
                assert found.faces.min() >= 0
                assert found.faces.max() < len(found.vertices)
    assert len(outcomes) >= 2, outcomes


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["stl", "obj", "glb"])
def test_what_is_read_of_mutated_meshes_is_voxelised_or_refused(kind: str) -> None:
    rng = random.Random(f"voxels of {kind}")
    made = 0
    while made < 4:
        try:
            found = read(mutated(FILES[kind], rng, SPICE))
            if not isinstance(found, Solid):
                continue
            made += 1
            voxels = voxelise(found, cells=rng.choice([1, 30, 200]))
        except InputError as refusal:
            assert refusal.detail.endswith(".")
        else:
            assert len(voxels.shape) >= 1
            assert 0 <= voxels.iou <= 1


WRITERS: tuple[Callable[[random.Random], bytes], ...] = (
    lambda rng: b"ply\n" + rng.randbytes(60),
    lambda rng: b"glTF" + rng.randbytes(60),
    lambda rng: b"VOX " + rng.randbytes(60),
    lambda rng: b"PK\x03\x04" + rng.randbytes(60),
    lambda rng: b"OFF\n" + rng.randbytes(60),
    lambda rng: b"#binvox" + rng.randbytes(60),
    lambda rng: b"solid facet" + rng.randbytes(200),
    lambda rng: b"v 0 0 0\nf " + rng.randbytes(60),
)


@pytest.mark.parametrize("writer", WRITERS)
def test_noise_after_a_signature_is_refused(writer: Callable[[random.Random], bytes]) -> None:
    rng = random.Random(1)
    for _ in range(300):
        with pytest.raises(InputError):
            read(writer(rng), filename="a.stl")
