"""Table certificate: known torques, verdicts, and the figures that it reports with them."""

import json
from pathlib import Path

import numpy as np
import pytest

from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.certificate.table_figures import TableCertificate
from foldback.planner.certificate.table_forces import TableForces
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.errors import InputError
from foldback.planner.motion.motion import Motion
from tests.case import case
from tests.planner.chains import anchored, coil, line
from tests.refusal import refused

LIFTED = 0.3
FRAMES = 5


def swing(chain: Chain, hinge: int, maximum: float = LIFTED, low: float = 0.5) -> Motion:
    """Return the motion of a straight lying chain that turns one hinge; module 0 is fixed."""
    angles = np.zeros((FRAMES, len(chain.folded_rad)))
    angles[:, hinge] = np.linspace(0.0, maximum, FRAMES)
    poses = forward_kinematics(
        chain.module, angles, root_position=np.tile([0.0, 0.0, low], (FRAMES, 1))
    )
    return anchored("playback", angles).with_columns(
        root_position=poses.positions[:, chain.root], root_wxyz=poses.wxyzs[:, chain.root]
    )


def test_swing_needs_torque_with_friction_alone() -> None:
    chain = line(7)
    computed_table_certificate = table_certificate(chain, swing(chain, 0))
    assert computed_table_certificate.on_table and computed_table_certificate.rests
    assert (
        computed_table_certificate.verdict
        == "rests on a table within 0 w·p in frame 0 (without friction)"
    )
    assert computed_table_certificate.standing == (tuple(range(7)),) * FRAMES
    assert computed_table_certificate.clearance == pytest.approx(0.0, abs=1e-12)
    computed_table_certificate = table_certificate(chain, swing(chain, 0), friction=0.1)
    free = table_certificate(chain, swing(chain, 0), friction=0.1, base="free")
    assert (
        computed_table_certificate.rests
        and "friction μ = 0.1" in computed_table_certificate.verdict
    )
    assert any(
        "Coulomb friction with the table (coefficient 0.1)" in line
        for line in computed_table_certificate.assumptions
    )
    assert (
        0.0
        < free.torque
        < computed_table_certificate.torque
        < 0.1 * sum(np.hypot(j, 0.5) for j in range(1, 6))
    )


def test_lifted_arm_needs_the_torque_of_its_weight() -> None:
    # Upwards is a negative angle about y. Five modules beyond the hinge, all lifted except in the
    # first frame, need cos a · 5 · 6 / 2.
    chain = line(7)
    computed_table_certificate = table_certificate(
        chain, swing(chain, 1, -LIFTED), module_kg=0.1, pitch_m=0.05, bound=20.0
    )
    angle = LIFTED / (FRAMES - 1)
    assert computed_table_certificate.torque == pytest.approx(15.0 * np.cos(angle), rel=1e-4)
    assert computed_table_certificate.frame == 1
    assert computed_table_certificate.torque_nm == pytest.approx(
        15.0 * np.cos(angle) * 0.1 * 9.81 * 0.05, rel=1e-4
    )
    assert computed_table_certificate.standing[-1] == (0, 1)
    assert computed_table_certificate.rests
    refused = table_certificate(chain, swing(chain, 1, -LIFTED), bound=10.0)
    assert not refused.rests
    assert "the limit is 10 w·p" in refused.verdict


def test_chain_that_tips_over_is_refused() -> None:
    chain = line(7)
    computed_table_certificate = table_certificate(chain, swing(chain, 1, -LIFTED), base="free")
    assert computed_table_certificate.unbalanced == (1, 2, 3, 4)
    assert computed_table_certificate.torques == (0.0, None, None, None, None)
    assert computed_table_certificate.verdict.startswith(
        "failed: the chain would tip over in 4 of 5 frames, first in frame 1"
    )


def test_chain_below_the_table_is_refused() -> None:
    chain = line(7)
    computed_table_certificate = table_certificate(chain, swing(chain, 0, low=0.45))
    assert computed_table_certificate.clearance == pytest.approx(-0.05)
    assert "0.05 pitch into the table" in computed_table_certificate.verdict
    smaller = table_certificate(chain, swing(chain, 0), module_size=0.9)
    assert smaller.rests and smaller.clearance == pytest.approx(0.0, abs=1e-12)


def test_floating_frames_are_put_down_and_refused() -> None:
    chain = coil(8)
    shares = np.linspace(0.0, 1.0, 20)
    angles = shares[:, None] * chain.folded_rad
    frames = anchored("playback", angles).with_columns(root_position=np.full((20, 3), 30.0))
    computed_table_certificate = table_certificate(chain, frames, base="clamped")
    assert not computed_table_certificate.on_table and not computed_table_certificate.rests
    assert computed_table_certificate.base == "free"
    assert computed_table_certificate.verdict.startswith(
        "failed: the chain floats, so a table does not support it"
    )
    assert "without friction" in computed_table_certificate.verdict
    assert (
        computed_table_certificate.torque is not None
        and 0.0 < computed_table_certificate.torque < 15.0
    )
    assert computed_table_certificate.torques[0] == computed_table_certificate.torques[-1] == 0.0
    as_windows = table_certificate(chain, frames.windowed(chain), on_table=False)
    assert as_windows.torques == pytest.approx(
        computed_table_certificate.torques, rel=1e-3, abs=0.011
    )


def test_table_certificate_is_read_back() -> None:
    chain = line(7)
    for base in ("clamped", "free"):
        computed_table_certificate = table_certificate(
            chain, swing(chain, 1, -LIFTED), base=base, friction=0.2
        )
        written = json.loads(json.dumps(computed_table_certificate.as_dict(), allow_nan=False))
        assert TableCertificate.from_dict(written) == computed_table_certificate
    with pytest.raises(InputError, match="expected 'foldback-table/1'"):
        TableCertificate.from_dict({"format": "foldback-plan/3"})


def test_frames_and_parameters_out_of_range_are_refused() -> None:
    chain = line(4)
    nan = float("nan")
    for wrong in (
        *({"friction": -0.1}, {"friction": nan}, {"module_kg": 0.0}, {"pitch_m": -1.0}),
        *({"module_size": 2.0}, {"bound": 0.0}, {"base": "held"}),
    ):
        with case(wrong), refused("bad-table", next(iter(wrong))):
            table_certificate(chain, swing(chain, 0), **wrong)
    frames = swing(chain, 0)
    with pytest.raises(InputError, match="frames"):
        table_certificate(chain, frames[:0])
    frames.root_position[2] = np.nan
    with pytest.raises(InputError, match="infinite or undefined"):
        table_certificate(chain, frames)


def test_table_forces_bear_the_whole_weight_and_are_read_back(tmp_path: Path) -> None:
    chain, forces = line(5), list[TableForces]()
    table_certificate(chain, swing(chain, 0), base="free", sink=forces.append)
    lifted = table_certificate(chain, swing(chain, 1), base="free", sink=forces.append)
    flat, sloped_forces = forces
    assert np.allclose(flat.torque, 0.0)
    assert (flat.pressed >= -1e-6).all()
    assert np.allclose(sloped_forces.pressed.sum(axis=1), 5.0, atol=1e-4)
    assert sloped_forces.torques.shape == (len(sloped_forces), len(chain.folded_rad))
    assert np.allclose(np.abs(sloped_forces.torques).max(axis=1), sloped_forces.torque, atol=0.011)
    assert sloped_forces.torque.max() == pytest.approx(lifted.torque)
    sloped_forces.save(tmp_path / "table.npz")
    second_table_forces = TableForces.load(tmp_path / "table.npz")
    for name in ("torques", "pressed", "torque"):
        assert np.array_equal(getattr(second_table_forces, name), getattr(sloped_forces, name))


def test_invalid_files_of_table_forces_are_refused(tmp_path: Path) -> None:
    for content in (None, b"PK", b""):
        path = tmp_path / "table.npz"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError, match="table.npz cannot be read"):
            TableForces.load(path)
    np.savez(path, torques=np.zeros((2, 3)), pressed=np.zeros((1, 4)), torque=np.zeros(2))
    with pytest.raises(InputError, match="got arrays"):
        TableForces.load(path)
