"""Faults of modules: each has a sentence that names the place in the file and what to do."""

import copy
import re
from typing import Any

import pytest

from foldback.planner.chain.built_in_modules import MODULE_NAMES, module_named
from foldback.planner.chain.module_checks import check_module, module_faults, module_notes
from foldback.planner.chain.module_file import MAX_MODULE_CORNERS, read_module
from foldback.planner.errors import InputError
from foldback.planner.readers.chain_json import read_chain
from foldback.planner.readers.limits import Source

SLAB = [[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.2, 0.2)]


def document() -> dict[str, Any]:
    """Return the description of a slab with a hinge at both ends, to be changed."""
    return {
        "format": "foldback-module/1",
        "name": "slab",
        "words": {"singular": "slab", "plural": "slabs"},
        "pieces": [
            {
                "name": "body",
                "parts": [{"corners": SLAB}],
                "entry": {"at": [-0.5, 0, 0]},
                "exit": {"at": [0.5, 0, 0]},
                "joint": {
                    "kind": "hinge",
                    "hinges": [{"axis": [0, 0, 1], "range_deg": [-80, 80]}],
                    "step_deg": 80,
                },
            }
        ],
        "pattern": ["body"],
    }


def changed(*changes: tuple[tuple[Any, ...], Any]) -> dict[str, Any]:
    """Return the description with other values at some places."""
    values = copy.deepcopy(document())
    for place, value in changes:
        inner: Any = values
        for key in place[:-1]:
            inner = inner[key]
        inner[place[-1]] = value
    return values


PIECE = ("pieces", 0)
JOINT = (*PIECE, "joint")
AXIS = (*JOINT, "hinges", 0, "axis")
RANGE = (*JOINT, "hinges", 0, "range_deg")
TWO_HINGES = [{"axis": [0, 0, 1], "name": "a"}, {"axis": [0, 1, 0], "name": "b"}]
PARALLEL = [{"axis": [0, 0, 1], "name": "a"}, {"axis": [0, 0, -1], "name": "b"}]
FAR_PART = {"corners": [[x + 2, y, z] for x, y, z in SLAB]}


@pytest.mark.parametrize("name", MODULE_NAMES)
def test_modules_that_come_with_foldback_have_no_fault(name: str) -> None:
    assert list(module_faults(module_named(name))) == []


@pytest.mark.parametrize(
    ("changes", "code", "message"),
    [
        ([((*JOINT, "kind"), "twist")], "axes-miss", r"hinges\[0\].axis: .* 90° off the line"),
        ([((*JOINT, "kind"), "universal")], "wrong-count", "1 hinges, expected 2"),
        ([((*JOINT, "hinges"), TWO_HINGES)], "wrong-count", "2 hinges, expected 1"),
        (
            [((*JOINT, "kind"), "universal"), ((*JOINT, "hinges"), PARALLEL)],
            "axes-miss",
            "angle of 0°, expected a right angle",
        ),
        ([((*PIECE, "exit", "at"), [1.8, 0, 0])], "axes-miss", r"exit.at: .* 1.5 pitches away"),
        ([((*PIECE, "exit", "at"), [-0.1, 0, 0])], "linked-overlap", "reaches 0.2 pitches into"),
        ([(RANGE, [-80, 150])], "unreachable-stop", r"-80° to 150°.* collide at 9\d"),
        ([(RANGE, None)], "unreachable-stop", "turns freely.* collide at 9"),
        ([((*PIECE, "parts"), [{"corners": SLAB}, FAR_PART])], "loose-parts", r"parts\[1\]"),
        (
            [((*PIECE, "parts", 0, "corners"), [[20 * c for c in corner] for corner in SLAB])],
            "bad-size",
            "8.25 pitches from its centre, expected 0.05 to 5",
        ),
        (
            [(("pattern",), ["body"] * 5), (("rest_deg",), [80, 80, 80, 80, 0])],
            "rest-overlap",
            "modules 1 and 5 overlap in the rest shape",
        ),
    ],
)
def test_fault_has_a_sentence(changes: Any, code: str, message: str) -> None:
    fault = next(module_faults(read_module(changed(*changes))))
    assert fault.code == code
    assert re.search(message, fault.message)


def test_piece_that_no_module_is_has_a_sentence() -> None:
    values = document()
    values["pieces"].append({**copy.deepcopy(values["pieces"][0]), "name": "end"})
    with pytest.raises(InputError, match="without the piece 'end'"):
        check_module(read_module(values))


def test_module_without_a_fault_passes() -> None:
    check_module(read_module(document()))


def test_hinge_hidden_in_both_modules_needs_a_statement() -> None:
    overlapping = changed(((*PIECE, "exit", "at"), [-0.1, 0, 0]), (("linked_overlap",), True))
    check_module(read_module(overlapping))


def test_mass_of_nothing_is_refused_and_a_missing_one_is_named() -> None:
    with pytest.raises(InputError, match=r"mass_kg"):
        read_module({**document(), "mass_kg": 0})
    (note,) = module_notes(read_module({**document(), "torque_nm": 2}))
    assert "2 N·m, but no mass" in note
    assert module_notes(read_module({**document(), "torque_nm": 2, "mass_kg": 0.1})) == ()


def test_chain_with_a_faulty_module_is_refused() -> None:
    chain = {"format": "foldback-chain/1", "joint_angles_deg": [0, 0]}
    source = Source(name="", max_cells=100)
    assert len(read_chain({**chain, "module": document()}, source)) == 3
    with pytest.raises(InputError, match="turns freely"):
        read_chain({**chain, "module": changed((RANGE, None))}, source)


def test_largest_modules_are_limited() -> None:
    def corners(k: int) -> list[list[float]]:
        """Return a part that shares a face with the next one."""
        return [[x / 4 + (k - 8) / 4, y, z] for x in (0, 1) for y in (0, 0.2) for z in (0, 0.2)]

    values = changed(
        ((*PIECE, "parts"), [{"corners": corners(k)} for k in range(16)]),
        ((*PIECE, "entry", "at"), [-2, 0.1, 0.1]),
        ((*PIECE, "exit", "at"), [2, 0.1, 0.1]),
        (RANGE, [-1, 1]),
    )
    assert list(module_faults(read_module(values))) == []
    values["pieces"] *= 1 + MAX_MODULE_CORNERS // 128
    with pytest.raises(InputError, match=f"at most {MAX_MODULE_CORNERS}"):
        read_module(values)
