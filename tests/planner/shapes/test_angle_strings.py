from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.chain.chain import Chain
from planner.chain.module import TETRAHEDRON
from planner.errors import InputError
from planner.readers import read
from planner.readers.angle_strings import read_angle_string

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
    assert (chain.name, len(chain)) == ("snake", 8)


@pytest.mark.parametrize("text", [b"0 0 0\n0 0 -1\n", b"0,0,0\n0,0,1\n0,1,1\n", b"0 0 0\n"])
def test_tables_of_cells_are_no_angle_strings(text: bytes) -> None:
    try:
        assert not isinstance(read(text), Chain)
    except InputError as error:
        assert error.code != "stray-character"


@pytest.mark.parametrize(
    ("text", "code", "where"),
    [
        ("0 - x +", "stray-character", "character 5"),
        ("+1", "stray-character", "character 2"),
        ("", "wrong-count", None),
        (" , ", "wrong-count", None),
        ("- - - + - - - + - - - +", "overlap", "modules 0 and 12"),
    ],
)
def test_bad_strings_are_refused_with_their_place(text: str, code: str, where: str | None) -> None:
    with pytest.raises(InputError) as refusal:
        read_angle_string(text)
    assert refusal.value.code == code
    assert (refusal.value.where or "").startswith(where or "")


@given(st.lists(st.sampled_from("0+-"), min_size=1, max_size=12))
def test_each_sign_is_a_turn(signs: list[str]) -> None:
    text = " ".join(signs)
    try:
        chain = read_angle_string(text)
    except InputError as error:
        assert error.code == "overlap"
        return
    turns = {"0": 0.0, "+": 90.0, "-": -90.0}
    np.testing.assert_allclose(np.rad2deg(chain.folded_rad), [turns[sign] for sign in signs])
