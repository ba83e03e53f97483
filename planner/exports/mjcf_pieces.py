"""MJCF of a long chain: trees of some modules each, welded end to end, as text.

MuJoCo reads elements nested 500 deep at most, and a tree's mass matrix grows with the square of its
length. So a long chain is cut: the tree ``root_<i>`` begins with module i, and its last body,
``ghost_<j>_body``, is where the next tree's first module is. Hinges are named as in a single tree,
and their values are the plan's angles.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.simulation.mujoco_models import hinge_names, mesh_name

MODULES_PER_TREE = 64
"""Number of modules in each kinematic tree of an MJCF model of a long chain; trees are joined by
weld constraints."""


def starts_of(chain: Chain) -> list[int]:
    """First modules of the trees."""
    count = len(chain)
    starts = list(range(0, count, MODULES_PER_TREE))
    # A tree needs a hinge, and the rigid link at the start has none.
    if count - starts[-1] < chain.module.rigid_links + 2 and len(starts) > 1:
        starts.pop()
    return starts


def pieces(chain: Chain, *, module_size: float) -> str:
    """Return the model without its keys and without the end of its root element."""
    return "\n".join(_lines(chain, module_size)) + "\n"


def coordinates(chain: Chain, angles_rad: Array, position: Array, wxyz: Array) -> Array:
    """(nq,) MuJoCo's coordinates of a configuration.

    Args:
        chain: The chain.
        angles_rad: (J,) hinge angles.
        position: (3,) centre of the chain's root module.
        wxyz: (4,) its orientation.
    """
    poses = chain.poses(angles_rad, position, wxyz)
    starts = starts_of(chain)
    turns = wxyz_from_matrix(poses.rotations[starts])
    module = chain.module
    parts: list[Array] = []
    for k, start in enumerate(starts):
        stop = starts[k + 1] if k + 1 < len(starts) else len(chain) - 1
        of_piece = slice(
            module.hinges_per_joint * max(0, module.joint_after(start)),
            module.hinges_per_joint * module.joint_after(stop),
        )
        parts.extend([poses.positions[start], turns[k], angles_rad[of_piece]])
    return np.concatenate(parts)


def _lines(chain: Chain, module_size: float) -> Iterator[str]:
    module, count = chain.module, len(chain)
    starts = starts_of(chain)
    yield '<mujoco model="foldback">'
    yield '  <compiler angle="radian" autolimits="true"/>'
    yield '  <option gravity="0 0 0"><flag filterparent="disable" autoreset="disable"/></option>'
    surface = 'condim="1" solref="0.03 1" solimp="0.95 0.99 0.005 0.5 2" mass="0"'
    meshes, shapes = _shapes(module, module_size)
    yield from meshes
    is_single = len(shapes) == len(shapes[0]) == 1
    alike = f"{shapes[0][0]} " if is_single else ""
    yield f'  <default><geom {alike}{surface}/><site size="0.02" group="4"/></default>'
    yield "  <worldbody>"

    @cache
    def inertial(piece: int, mass: float) -> str:
        moments = _numbers(module.pieces[piece].inertia * mass)
        return f'<inertial pos="0 0 0" mass="{mass!r}" diaginertia="{moments}"/>'

    def named(index: int) -> str:
        geoms = (
            f'<geom name="module_{index}{f"_{k}" if k else ""}"{"" if is_single else f" {shape}"}/>'
            for k, shape in enumerate(shapes[numbers[index]])
        )
        return f'{"".join(geoms)}<site name="module_{index}"/>'

    def linked(index: int) -> str:
        place, hinges = links[rows[index - 1]]
        names = zip(hinge_names(chain, index - 1), hinges, strict=False)
        return place + "".join(f'<joint name="{name}" {hinge}/>' for name, hinge in names)

    modules = np.arange(count)
    masses = module.masses(count).tolist()
    numbers = module.piece_numbers[modules % len(module.pattern)].tolist()
    rows, links = module.joint.row(modules).tolist(), _links(module)
    for k, start in enumerate(starts):
        stop = starts[k + 1] if k + 1 < len(starts) else count
        yield f'<body name="module_{start}"><freejoint name="root_{start}"/>'
        yield f"{inertial(numbers[start], masses[start] * (0.5 if k else 1.0))}{named(start)}"
        for i in range(start + 1, stop):
            mass = inertial(numbers[i], masses[i])
            yield f'<body name="module_{i}" {linked(i)}{mass}{named(i)}'
        if stop < count:
            half = inertial(numbers[stop], 0.5 * masses[stop])
            yield f'<body name="ghost_{stop}" {linked(stop)}{half}</body>'
        yield "</body>" * (stop - start)
    yield "  </worldbody>"
    yield "  <contact>"
    for i, j in module.exempt_pairs(count):
        yield f'<exclude body1="module_{i}" body2="module_{j}"/>'
    yield "  </contact>"
    yield "  <equality>"
    for start in starts[1:]:
        yield (
            f'<weld body1="ghost_{start}" body2="module_{start}" relpose="0 0 0 1 0 0 0" '
            'solref="0.02 1" solimp="0.9999 0.9999 0.001 0.5 2"/>'
        )
    yield "  </equality>"


def _links(module: Module) -> list[tuple[str, list[str]]]:
    """Return the pose of a body in that of the one before it, and its hinges but for their names.

    One of each row of ``Module.joint``, as long chains have many links of few kinds.
    """
    joint = module.joint
    columns = (joint.anchor, joint.axes, joint.turn, joint.offset)
    stops = module.stops_behind(module.joint_holders)
    links: list[tuple[str, list[str]]] = []
    for anchor, axes, turn, offset, ranges in zip(*columns, stops, strict=True):
        place = _numbers(anchor + turn @ offset)
        hinges = [
            f'pos="{_numbers(-offset)}" axis="{_numbers(turn.T @ axis)}" range="{_numbers(ends)}"'
            for axis, ends in zip(axes, ranges, strict=True)
        ]
        links.append((f'pos="{place}" quat="{_numbers(wxyz_from_matrix(turn))}">', hinges))
    return links


def _shapes(module: Module, module_size: float) -> tuple[list[str], list[list[str]]]:
    """Return the lines of all meshes, and the attributes of the geoms of each piece's parts."""
    meshes: list[str] = []
    shapes: list[list[str]] = []
    for first, piece in zip(module.hull.pieces[:, 0].tolist(), module.pieces, strict=True):
        shapes.append([])
        for number, part in enumerate(piece.parts, start=first):
            if part.box is not None:
                centre, half = (module_size * place for place in part.box)
                place = f'pos="{_numbers(centre)}" ' if centre.any() else ""
                shapes[-1].append(f'type="box" {place}size="{_numbers(half)}"')
                continue
            name = mesh_name(module, number)
            vertices = _numbers((part.corners * module_size).ravel())
            meshes.append(f'  <asset><mesh name="{name}" vertex="{vertices}"/></asset>')
            shapes[-1].append(f'type="mesh" mesh="{name}"')
    return meshes, shapes


def _numbers(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values).ravel())
