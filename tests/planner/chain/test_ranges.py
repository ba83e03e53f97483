"""Ranges of hinges: each has its own, some have none."""

from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import MAX_FREE_TURN_RAD, Module
from foldback.planner.chain.module_file import read_module
from foldback.planner.errors import InputError
from foldback.planner.exports import urdf
from foldback.planner.pipeline.fold import fold
from tests.planner.brackets import box


def hinged(axis: list[int], range_deg: list[float] | None) -> dict[str, Any]:
    """Return a box of which the next one turns about an axis."""
    hinge = {"axis": axis} if range_deg is None else {"axis": axis, "range_deg": range_deg}
    return {
        "name": "".join(map(str, axis)),
        "parts": [box([-0.45] * 3, [0.45] * 3)],
        "entry": {"at": [-0.5, 0, 0]},
        "exit": {"at": [0.5, 0, 0]},
        "joint": {"kind": "hinge", "hinges": [hinge]},
    }


def module_of(pieces: list[dict[str, Any]], *, linked_overlap: bool = True) -> Module:
    """Return a module whose pieces follow each other in turn."""
    return read_module(
        {
            "format": "foldback-module/1",
            "name": "hinged-box",
            "words": {"singular": "box", "plural": "boxes"},
            "pieces": pieces,
            "pattern": [piece["name"] for piece in pieces],
            "linked_overlap": linked_overlap,
        }
    )


UNEVEN = module_of([hinged([0, 0, 1], [-30, 90]), hinged([0, 1, 0], [-90, 90])])
FREE = module_of([hinged([0, 0, 1], None), hinged([0, 1, 0], [-45, 120])])


def test_a_folded_angle_beyond_the_range_of_its_hinge_is_refused_with_that_range() -> None:
    Chain.from_angles(UNEVEN, np.deg2rad([90.0, -90.0, -30.0, 0.0]))
    with pytest.raises(InputError, match=r"joint 2: got -80°, expected -30° to 90°\."):
        Chain.from_angles(UNEVEN, np.deg2rad([90.0, -90.0, -80.0, 0.0]))
    with pytest.raises(InputError, match=r"joint 1: got 91°, expected at most 90° in either"):
        Chain.from_angles(UNEVEN, np.deg2rad([90.0, 91.0, 0.0, 0.0]))


def test_stops_are_early_but_let_the_folded_shape_be() -> None:
    chain = Chain.from_angles(UNEVEN, np.deg2rad([90.0, 20.0, -29.9, 0.0]))
    stops = np.rad2deg(chain.stops_rad(np.deg2rad(1.0)))
    np.testing.assert_allclose(stops, [[-29, 90], [-89, 89], [-29.9, 89], [-89, 89]])
    np.testing.assert_allclose(np.rad2deg(chain.ranges_rad[:2]), [[-30, 90], [-90, 90]])


def test_hinges_without_a_range_stop_short_of_a_turn() -> None:
    chain = Chain.from_angles(FREE, np.deg2rad([95.0, 20.0, 0.0]))
    assert np.isinf(chain.ranges_rad[[0, 2]]).all()
    assert chain.stops_rad()[0].tolist() == [-MAX_FREE_TURN_RAD, MAX_FREE_TURN_RAD]
    assert FREE.largest_angle_rad == MAX_FREE_TURN_RAD


@pytest.mark.slow
def test_a_shape_folded_up_to_the_ends_of_ranges_is_verified_and_exported() -> None:
    pieces = [hinged([0, 0, 1], [-30, 90]), hinged([0, 1, 0], [-90, 90]), hinged([1, 0, 0], None)]
    chain = Chain.from_angles(module_of(pieces), np.deg2rad([90.0, -90.0, 100.0, 20.0, 60.0]))
    plan = fold(chain)
    assert plan.certificate.verdict == "verified (simulated)"
    ranges, angles = chain.ranges_rad, plan.motion.joint_angles_rad
    assert (angles >= ranges[:, 0] - 1e-6).all() and (angles <= ranges[:, 1] + 1e-6).all()
    assert np.abs(angles[-1] - chain.folded_rad).max() < 1e-6
    joints = list(ElementTree.fromstring(urdf.write(plan)).iter("joint"))
    for joint, (low, high) in zip(joints, ranges, strict=True):
        (limit,) = joint.iter("limit")
        assert joint.attrib["type"] == ("revolute" if np.isfinite(low) else "continuous")
        ends = [limit.attrib.get(name) for name in ("lower", "upper")]
        expected = [repr(float(low)), repr(float(high))]
        assert ends == (expected if np.isfinite(low) else [None, None])
