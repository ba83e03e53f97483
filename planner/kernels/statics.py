"""What forces on the modules of a chain ask of its hinges, as a sparse matrix, compiled.

The moment about a hinge is that of all forces beyond it. Of two forces of a contact between modules
that cancels out for all hinges but those between the two, so that its column is short.
"""
# pyright: reportUntypedFunctionDecorator=false

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Int32s = NDArray[np.int32]
EQUATIONS = 6
"""Rows behind those of the hinges: force and moment of all that acts on a chain that is free."""


class Hinges(NamedTuple):
    """The hinges of a configuration, in the world's frame.

    Attributes:
        axes: (J, 3) unit axes.
        anchors: (J, 3) points on them.
        before: (J,) the module before each.
    """

    axes: Array
    anchors: Array
    before: Ints


@njit(cache=True)
def _turning(axis: Array, anchor: Array, point: Array, force: Array) -> float:
    """The moment of a force about an axis."""
    x, y, z = point[0] - anchor[0], point[1] - anchor[1], point[2] - anchor[2]
    return (
        axis[0] * (y * force[2] - z * force[1])
        + axis[1] * (z * force[0] - x * force[2])
        + axis[2] * (x * force[1] - y * force[0])
    )


@njit(cache=True)
def columns(
    hinges: Hinges,
    root: int,
    held: bool,
    first: Ints,
    second: Ints,
    points: Array,
    forces: Array,
) -> tuple[Int32s, Int32s, Array]:
    """What each of C unit forces asks of the hinges, by columns: starts, rows and values.

    A hinge's torque is what the module before it exerts on the one behind. Unless the root is held,
    force and moment on the whole chain follow as ``EQUATIONS`` rows; forces between modules have
    none of them.

    Args:
        hinges: The hinges.
        root: The module from which on hinges are reached; where the root is held that is the one.
        held: Whether the root is held still, by whatever force that takes.
        first: (C,) the module on which a force acts.
        second: (C,) the one on which its opposite acts; negative for none.
        points: (C, 3) where.
        forces: (C, 3) the force on the first.
    """
    count = first.shape[0]
    hinge_count = hinges.before.shape[0]
    room = 16 * (count + 1)
    starts = np.empty(count + 1, dtype=np.int32)
    rows = np.empty(room, dtype=np.int32)
    values = np.empty(room)
    at = 0
    before = hinges.before
    for c in range(count):
        starts[c] = at
        if at + hinge_count + EQUATIONS > room:
            room = 2 * room + hinge_count + EQUATIONS
            larger_rows = np.empty(room, dtype=np.int32)
            larger_rows[:at] = rows[:at]
            rows = larger_rows
            larger_values = np.empty(room)
            larger_values[:at] = values[:at]
            values = larger_values
        i, j = first[c], second[c]
        # Hinges between `low` and `high` feel it; those behind the force lose what is on them.
        low, high = min(i, j if j >= 0 else root), max(i, j if j >= 0 else root)
        sign = -1.0 if i == high else 1.0
        if low == high:
            low = high = -1
        start = np.searchsorted(before, low)
        stop = np.searchsorted(before, high)
        for h in range(start, stop):
            value = sign * _turning(hinges.axes[h], hinges.anchors[h], points[c], forces[c])
            if abs(value) > 1e-12:
                rows[at] = h
                values[at] = value
                at += 1
        if j < 0 and not held:
            x, y, z = points[c, 0], points[c, 1], points[c, 2]
            fx, fy, fz = forces[c, 0], forces[c, 1], forces[c, 2]
            whole = (fx, fy, fz, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx)
            for r in range(EQUATIONS):
                if abs(whole[r]) > 1e-12:
                    rows[at] = hinge_count + r
                    values[at] = whole[r]
                    at += 1
    starts[count] = at
    return starts, rows[:at].copy(), values[:at].copy()
