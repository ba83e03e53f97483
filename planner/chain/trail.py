"""Trails: the order in which a chain of tetrahedra visits the tetragonal disphenoid honeycomb.

Nodes are the middles of the tetrahedra's long edges: the integer points with one or two odd
coordinates. A tetrahedron is a pair of nodes one apart; at each node four of them meet around one
long edge, its hinge axis. A chain is a trail through the nodes that uses no pair twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foldback.planner.chain.path import (
    DEFAULT_PITCH_M,
    MAX_COORDINATE,
    check_pitch,
)
from foldback.planner.errors import InputError

Nodes = NDArray[np.int64]
MIN_NODES = 3
"""Minimum number of nodes (hinges' middles and both ends) of a trail, the path of a chain of
tetrahedra: a shorter chain has no hinge, and is refused."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trail:
    """A trail of tetrahedra.

    Attributes:
        name: Name of the shape.
        nodes: (n + 1, 3) int64, read-only: module ``i`` lies between nodes ``i`` and ``i + 1``.
        pitch_m: Distance of the middles of a module's two hinges in metres.
    """

    name: str
    nodes: Nodes
    pitch_m: float = DEFAULT_PITCH_M

    @classmethod
    def from_nodes(
        cls, nodes: ArrayLike, *, name: str = "trail", pitch_m: float = DEFAULT_PITCH_M
    ) -> Trail:
        """Check nodes and build a trail of them.

        Args:
            nodes: (n + 1, 3) whole numbers in the order of the chain.
            name: Name of the shape.
            pitch_m: Distance of the middles of a module's two hinges in metres.

        Raises:
            InputError: Naming the nodes that break the rule.
        """
        raw: NDArray[Any] = np.asarray(nodes)
        if raw.ndim != 2 or raw.shape[1] != 3 or raw.dtype.kind not in "iu":
            raise InputError(
                "not-nodes",
                f"got an array of shape {raw.shape} and type {raw.dtype}, expected whole numbers "
                "in an array of shape (n + 1, 3) for n modules, one node per row.",
            )
        if len(raw) < MIN_NODES:
            raise InputError(
                "too-few-nodes",
                f"got {len(raw)} nodes, expected at least {MIN_NODES}; a chain needs "
                "two modules and a hinge.",
            )
        check_pitch(pitch_m)
        int_nodes = raw.astype(np.int64)
        farthest = int(int_nodes.flat[np.abs(int_nodes).argmax()])
        if abs(farthest) > MAX_COORDINATE:
            raise InputError(
                "too-far",
                f"got the coordinate {farthest}, expected −{MAX_COORDINATE} to {MAX_COORDINATE}; "
                "move the shape to the origin.",
            )
        _check(int_nodes)
        int_nodes.setflags(write=False)
        return cls(name=name, nodes=int_nodes, pitch_m=float(pitch_m))

    def __len__(self) -> int:
        """Number of modules."""
        return len(self.nodes) - 1


def hinge_axes(nodes: Nodes) -> Nodes:
    """(n,) axis, 0 to 2, of the long edge at each node: its one odd or its one even coordinate."""
    odd = nodes % 2 != 0
    return np.where(odd.sum(axis=1) == 1, np.argmax(odd, axis=1), np.argmin(odd, axis=1))


def _check(nodes: Nodes) -> None:
    odd = (nodes % 2 != 0).sum(axis=1)
    for bad, code, expectation in (
        ((odd == 0) | (odd == 3), "not-a-node", "expected one or two odd coordinates"),
        (
            np.append(np.abs(np.diff(nodes, axis=0)).sum(axis=1) != 1, False),
            "not-adjacent",
            "expected the next node to be one step away",
        ),
    ):
        if bad.any():
            index = int(np.argmax(bad))
            raise InputError(
                code,
                f"got {tuple(map(int, nodes[index]))}, {expectation}.",
                where="node {node}",
                node=index,
            )
    keys = np.concatenate([nodes[:-1] + nodes[1:]])
    _, first, counts = np.unique(keys, axis=0, return_index=True, return_counts=True)
    if (counts > 1).any():
        key = keys[first[np.argmax(counts > 1)]]
        a, b = np.flatnonzero((keys == key).all(axis=1))[:2]
        raise InputError(
            "repeated-cell",
            "modules {modules} occupy the same tetrahedron; a trail uses each tetrahedron once.",
            where="modules {modules}",
            modules=[int(a), int(b)],
        )
