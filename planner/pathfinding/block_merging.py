"""Block merging: a path through every connected shape of 2×2×2 blocks, in linear time.

Each block of eight cells has a Hamiltonian cycle. Along a spanning tree of the blocks the cycles of
two neighbours are joined where an edge of the one faces an edge of the other: both edges go, two
links come, and two cycles are one. In the end there is one cycle, which is cut open.

It always succeeds. Of every block it is known by which face and edge it is joined to its parent in
the tree. Whichever these are, there are a cycle of the block with that edge and six different edges
of the cycle, one in each face and that one among them (24 cases, listed below by enumeration). So
each child can be given an edge of its own, and no join undoes another.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import permutations, product
from typing import Final, Literal, TypeAlias

import numpy as np

from foldback.planner.arrays import Array, Ints
from foldback.planner.errors import InputError
from foldback.planner.pathfinding.lattice import contacts, spreads_of_cuts, surface
from foldback.planner.shapes.shape import Shape

Tree: TypeAlias = Literal["bfs", "dfs", "random"]

BLOCK_CORNERS: Final = tuple(product((0, 1), repeat=3))
FACES: Final = tuple(product(range(3), (0, 1)))
"""Faces of a 2×2×2 block as (axis, side): the axis (0 to 2) that the face is perpendicular to, and
its lower (0) or upper (1) side. The faces with indices k and k ^ 1 are opposite."""

Edge: TypeAlias = tuple[int, int]
"""Two corners of a block, the lower number first."""


def halved(shape: Shape) -> Ints | None:
    """Return the (m, 3) blocks of a shape of 2×2×2 blocks on one grid, else None.

    Cell ``c`` of the shape lies in block ``(c − offset) // 2``; the offset is the least cell of the
    shape's bounding box, or one less on some axes.
    """
    aligned = aligned_blocks(shape.cells)
    return None if aligned is None else aligned[0]


def aligned_blocks(cells: Ints) -> tuple[Ints, Ints] | None:
    """Return (m, 3) blocks and (3,) offset: the cells are ``offset + 2 · block + {0, 1}³``."""
    if len(cells) % 8:
        return None
    low = cells.min(axis=0)
    for corner in BLOCK_CORNERS:
        offset = low - np.array(corner)
        coarse, counts = np.unique((cells - offset) // 2, axis=0, return_counts=True)
        if len(coarse) * 8 == len(cells) and (counts == 8).all():
            return coarse, offset
    return None


def block_path(coarse: Ints, rng: np.random.Generator, *, tree: Tree = "bfs") -> Ints:
    """Return a path through blocks with both ends outside and a small spread.

    Args:
        coarse: (m, 3) the blocks; block b holds the cells 2·b + {0, 1}³.
        rng: Random choice of the tree and the edges.
        tree: Kind of spanning tree that joins the blocks.

    Returns:
        (8·m, 3) the cells in order. The last one touches the first one.

    Raises:
        InputError: ``disconnected`` when the blocks are not connected by their faces.
    """
    cycle = block_cycle(coarse, rng, tree=tree)
    return cut(cycle, int(np.argmin(cut_costs(cycle))))


def cut_costs(cycle: Ints) -> Array:
    """Return the (n,) spread of cuts before each cell; infinite if an end would lie inside."""
    outer = surface(cycle)
    both_outer = outer & np.roll(outer, 1)
    return np.where(both_outer | ~both_outer.any(), spreads_of_cuts(cycle), np.inf)


def cut(cycle: Ints, place: int) -> Ints:
    """Return the (n, 3) cycle, opened before the cell with this index."""
    return np.roll(cycle, -place, axis=0)


def block_cycle(coarse: Ints, rng: np.random.Generator, *, tree: Tree = "bfs") -> Ints:
    """Return the (8·m, 3) cells of the closed cycle, see ``block_path``."""
    blocks = np.unique(np.asarray(coarse, dtype=np.int64), axis=0)
    blocks = blocks[rng.permutation(len(blocks))]
    order, parents = _spanning_tree(blocks, rng, tree)
    options = joint_options()
    picks = rng.integers(1 << 30, size=len(blocks)).tolist()
    first = sorted(options)[picks[0] % len(options)]
    edges_of_block: list[tuple[Edge, ...]] = [()] * len(blocks)
    # Each corner has two links; a link is a step along an axis, the corner determines the side.
    links = np.empty((len(blocks), 8, 2, 2), dtype=np.int64)
    steps = blocks[order[1:]] - blocks[parents[order[1:]]]
    axes = np.abs(steps).argmax(axis=1)
    faces = (2 * axes + (steps.sum(axis=1) < 0)).tolist()  # the child's face to its parent
    parent_of = parents.tolist()
    for rank, block in enumerate(order.tolist()):
        parent_edge, parent = None, -1
        if rank:
            parent = parent_of[block]
            face = faces[rank - 1]
            parent_edge = edges_of_block[parent][face ^ 1]
            bit = 4 >> (face >> 1)
            own_edge = (parent_edge[0] ^ bit, parent_edge[1] ^ bit)
        else:
            face, own_edge = first
        fitting = options[face, own_edge]
        ring, edges_of_faces = fitting[picks[rank] % len(fitting)]
        edges_of_block[block] = edges_of_faces
        links[block, :, :, 0] = block
        links[block, :, :, 1] = ring
        if parent_edge is not None:
            for a, b in zip(parent_edge, own_edge, strict=True):
                _relink(links, (parent, a), parent_edge, (block, b))
                _relink(links, (block, b), own_edge, (parent, a))
    return _cells_of(blocks, _walk(links))


def _relink(links: Ints, cell: tuple[int, int], edge: Edge, to: tuple[int, int]) -> None:
    """Replace the link of a cell along an edge of its own block by one to another block."""
    block, corner = cell
    far_end = edge[0] if corner == edge[1] else edge[1]
    pair = links[block, corner]
    slot = 0 if pair[0, 0] == block and pair[0, 1] == far_end else 1
    pair[slot] = to


def _walk(links: Ints) -> Ints:
    """Return the (8·m,) corners in the order of the cycle, as 8 · block + corner."""
    flat = (8 * links[..., 0] + links[..., 1]).reshape(-1, 2)
    froms, two = flat[:, 0].tolist(), flat[:, 1].tolist()
    before, at = froms[0], 0
    walk = [0] * len(flat)
    for place in range(len(flat)):
        walk[place] = at
        before, at = at, (two[at] if froms[at] == before else froms[at])
    if at != 0 or len(set(walk)) != len(walk):
        raise AssertionError("the blocks did not join into one cycle")
    return np.array(walk, dtype=np.int64)


def _cells_of(blocks: Ints, walk: Ints) -> Ints:
    return 2 * blocks[walk // 8] + np.array(BLOCK_CORNERS, dtype=np.int64)[walk % 8]


def _spanning_tree(blocks: Ints, rng: np.random.Generator, tree: Tree) -> tuple[Ints, Ints]:
    """Return the blocks with parents first, and the parent of each block."""
    from scipy.sparse import csr_array  # late: most folds join no blocks
    from scipy.sparse.csgraph import (
        breadth_first_order,
        connected_components,
        depth_first_order,
        minimum_spanning_tree,
    )

    count = len(blocks)
    pairs = contacts(blocks)
    # Weights are above zero, which a sparse matrix needs; only a random tree looks at them.
    weights = 1.0 + rng.random(len(pairs))
    # SciPy before 1.17.1 finds no spanning trees of graphs with 64-bit indices.
    graph = csr_array((weights, pairs.T.astype(np.int32)), shape=(count, count))
    part_count, _ = connected_components(graph, directed=False)
    if part_count > 1:
        raise InputError(
            "disconnected",
            f"got blocks in {part_count} separate parts, expected one connected part; keep the "
            "largest part or join the parts.",
        )
    if tree == "random":
        graph = minimum_spanning_tree(graph)
    search = depth_first_order if tree == "dfs" else breadth_first_order
    order, parents = search(graph, 0, directed=False, return_predecessors=True)
    return np.asarray(order, dtype=np.int64), np.asarray(parents, dtype=np.int64)


Option: TypeAlias = "tuple[Ints, tuple[Edge, ...]]"


@lru_cache(maxsize=1)
def joint_options() -> dict[tuple[int, Edge], list[Option]]:
    """Return for each joined face and edge the block's cycles, with an edge for each face.

    A cycle is (8, 2): the corners that each corner is linked to.
    """
    options: dict[tuple[int, Edge], list[Option]] = {}
    for ring in _rings():
        links = np.array(
            [[a ^ b ^ corner for a, b in ring if corner in (a, b)] for corner in range(8)]
        )
        in_face = [
            [edge for edge in ring if all(BLOCK_CORNERS[c][axis] == side for c in edge)]
            for axis, side in FACES
        ]
        for edges in product(*in_face):
            if len(set(edges)) == 6:
                for face, edge in enumerate(edges):
                    options.setdefault((face, edge), []).append((links, edges))
    return options


def _rings() -> list[tuple[Edge, ...]]:
    """Return the six Hamiltonian cycles of a block."""
    rings: set[tuple[Edge, ...]] = set()
    for (a, b, c), start in product(permutations((4, 2, 1)), range(8)):
        at, edges = start, list[Edge]()
        for bit in (a, b, a, c, a, b, a, c):
            edges.append((min(at, at ^ bit), max(at, at ^ bit)))
            at ^= bit
        rings.add(tuple(sorted(edges)))
    return sorted(rings)
