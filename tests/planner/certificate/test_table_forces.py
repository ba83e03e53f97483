"""Forces on a table: those of the certificate, kept in a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from planner.certificate.table import table_certificate
from planner.certificate.table_forces import TableForces
from planner.errors import InputError
from tests.planner.certificate.test_table import moving
from tests.planner.chains import line

LENGTH = 5


def forces(hinge: int) -> tuple[TableForces, float | None]:
    chain, kept = line(LENGTH), list[TableForces]()
    found = table_certificate(chain, moving(chain, hinge), base="free", sink=kept.append)
    return kept[0], found.torque


def test_table_bears_the_whole_weight_in_every_frame() -> None:
    found, largest = forces(hinge=1)
    assert np.allclose(found.pressed.sum(axis=1), LENGTH, atol=1e-4)
    assert found.torques.shape == (len(found), len(line(LENGTH).folded_rad))
    assert np.allclose(np.abs(found.torques).max(axis=1), found.torque, atol=0.011)
    assert found.torque.max() == pytest.approx(largest)


def test_flat_chain_is_borne_without_torque() -> None:
    found, _ = forces(hinge=0)
    assert np.allclose(found.torque, 0.0)
    assert (found.pressed >= -1e-6).all()


def test_table_forces_are_read_back(tmp_path: Path) -> None:
    found, _ = forces(hinge=1)
    found.save(tmp_path / "table.npz")
    again = TableForces.load(tmp_path / "table.npz")
    for name in ("torques", "pressed", "torque"):
        assert np.array_equal(getattr(again, name), getattr(found, name))


def test_invalid_files_of_table_forces_are_refused(tmp_path: Path) -> None:
    for content in (None, b"PK", b""):
        path = tmp_path / "table.npz"
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError, match="expected table.npz"):
            TableForces.load(path)
    np.savez(path, torques=np.zeros((2, 3)), pressed=np.zeros((1, 4)), torque=np.zeros(2))
    with pytest.raises(InputError, match="got arrays"):
        TableForces.load(path)
