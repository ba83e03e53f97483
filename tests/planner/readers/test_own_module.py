"""Modules of one's own: files alone, with a chain file, and with typed angles."""

import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.errors import InputError
from foldback.planner.readers import read
from foldback.planner.readers.own_module import (
    built_in_or_file,
    chain_of_angles,
    read_module_file,
    with_module,
)
from tests.planner.chain.test_module_checks import document

CHAIN = {"format": "foldback-chain/1", "name": "bow", "joint_angles_deg": [30, 0, 30]}


def file_of(values: dict[str, Any]) -> bytes:
    """Return a JSON file."""
    return json.dumps(values).encode()


def test_module_alone_is_checked_and_asks_for_angles() -> None:
    with pytest.raises(InputError, match="no faults, but a fold also needs") as refusal:
        read(file_of({**document(), "torque_nm": 2}))
    assert refusal.value.code == "module-alone"
    assert "no mass" in refusal.value.message
    with pytest.raises(InputError, match="without the piece"):
        values = document()
        values["pieces"].append({**values["pieces"][0], "name": "end"})
        read(file_of(values))


def test_chain_file_and_module_file_make_a_chain() -> None:
    module = read_module_file(file_of({**document(), "pitch_m": 0.04}))
    chain = read(with_module(file_of(CHAIN), module))
    assert isinstance(chain, Chain)
    assert (chain.name, chain.module.name, chain.pitch_m) == ("bow", "slab", 0.04)
    np.testing.assert_allclose(np.rad2deg(chain.folded_rad), [30, 0, 30])


def test_typed_angles_and_module_file_make_a_chain() -> None:
    module = read_module_file(file_of(document()))
    chain = read(chain_of_angles(" 30, 0\t\u221245.5\n", module))
    assert isinstance(chain, Chain)
    np.testing.assert_allclose(np.rad2deg(chain.folded_rad), [30, 0, -45.5])
    cubes = read(chain_of_angles("0 90 0 0", built_in_or_file("cube", None)))
    assert isinstance(cubes, Chain) and len(cubes) == 4


Action = Callable[[Module], object]
REFUSALS: list[tuple[Action, str]] = [
    (lambda slab: with_module(file_of({**CHAIN, "module": "cube"}), slab), "\"cube\".*'slab'"),
    (lambda slab: with_module(b"[[0, 0, 0], [1, 0, 0]]", slab), "got none.*foldback-chain/1"),
    (lambda slab: with_module(file_of(document()), slab), "expected.*foldback-chain/1"),
    (lambda slab: chain_of_angles("30 bent", slab), "'bent' after 1 angles"),
    (lambda _: chain_of_angles("0 90 0", built_in_or_file("cube", None)), "multiple of 2"),
    (lambda _: built_in_or_file("slab", None), "expected a module file, or one of: cube"),
    (lambda _: read_module_file(file_of(CHAIN)), "expected.*foldback-module/1"),
    (lambda _: read_module_file(b'{"format": 1, "format": 2}'), "more than once"),
    (lambda _: read_module_file(b"\x00\x01"), "."),
]


@pytest.mark.parametrize(("action", "message"), REFUSALS)
def test_refusals(action: Action, message: str) -> None:
    slab = read_module_file(file_of(document()))
    with pytest.raises(InputError, match=message):
        action(slab)
