"""Checks of a described module: whether its pieces and joints make a chain that can turn."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import DEFAULT_MODULE_SIZE, Module, Piece
from foldback.planner.chain.rotations import axis_rotation
from foldback.planner.core import pair_separation
from foldback.planner.core.structures import Hull
from foldback.planner.errors import InputError

TOUCHING: Final = 1e-6
"""Separation of two bodies, in pitches, and deviation of a direction, in rad, that rounding of a
file's numbers may cause."""
SIZES: Final = (0.05, 5.0)
"""Smallest and largest distance, in pitches, from the centre of a piece to its farthest corner.
The distance of neighbouring joints is about one pitch."""
MAX_JOINT_GAP: Final = 1.0
"""Largest distance of a joint from each of the two bodies that it links, in pitches."""
STOP_STEPS: Final = 24
"""Number of steps in which a hinge is turned from zero to its stop to find a collision."""
HALVINGS: Final = 12
"""Number of halvings of the step in which a hinge collides; for steps of 7.5°, 12 find the angle
to 0.002°."""


def check_module(module: Module) -> None:
    """Refuse a module that has a fault.

    Raises:
        InputError: The first fault, with its place in the module file.
    """
    for fault in module_faults(module):
        raise fault


def module_faults(module: Module) -> Iterator[InputError]:
    """Yield the faults of a module, each with its place in the module file."""
    for number, piece in enumerate(module.pieces):
        yield from _piece_faults(module, piece, f"pieces[{number}]")
    yield from _pattern_faults(module)
    if module.apart > 1:
        return
    for pair in _linked_pairs(module):
        overlap = _overlap_at_rest(module, pair)
        if overlap is not None:
            yield overlap
        else:
            yield from _unreachable_stops(module, pair)
    if module.rest_rad is not None:
        yield from _rest_faults(module)


def module_notes(module: Module) -> tuple[str, ...]:
    """Return sentences on what the file leaves open."""
    if module.torque_nm is None or module.mass_kg is not None:
        return ()
    return (
        f"The module has a torque of {module.torque_nm:g} N·m, but no mass; add mass_kg, and "
        "foldback compares the torque with the weight.",
    )


def _fault(code: str, place: str, text: str) -> InputError:
    return InputError(code, text, where=place)


def _piece_faults(module: Module, piece: Piece, place: str) -> Iterator[InputError]:
    low, high = SIZES
    if not low <= piece.radius <= high:
        yield _fault(
            "bad-size",
            f"{place}.parts",
            f"got a piece whose farthest corner is {piece.radius:.3g} pitches from its centre, "
            f"expected {low:g} to {high:g}; give all lengths in pitches, one pitch being the "
            "distance of neighbouring joints.",
        )
    yield from _loose_parts(module, piece, place)
    yield from _axis_faults(module, piece, place)


def _loose_parts(module: Module, piece: Piece, place: str) -> Iterator[InputError]:
    """Yield the fault of a piece that is not connected."""
    first = sum(len(p.parts) for p in module.pieces[: module.pieces.index(piece)])
    hull = _parts_as_pieces(module.hull, first, len(piece.parts))
    reached, pending = {0}, [0]
    while pending:
        a = pending.pop()
        for b in set(range(len(piece.parts))) - reached:
            apart = pair_separation(np.zeros(3), np.eye(3), np.eye(3), hull, 1.0, 1.0, a, b)
            if apart <= TOUCHING:
                reached.add(b)
                pending.append(b)
    if loose := set(range(len(piece.parts))) - reached:
        yield _fault(
            "loose-parts",
            f"{place}.parts[{min(loose)}]",
            "got a part that touches no other part of its piece, expected one rigid body; move "
            "the part, add one that joins them, or make it a piece with a joint of its own.",
        )


def _parts_as_pieces(hull: Hull, first: int, parts: int) -> Hull:
    """Return a hull of so many pieces, each of one part."""
    numbers = first + np.arange(parts)
    return hull._replace(
        pieces=np.stack([numbers, numbers + 1], axis=1), kinds=np.arange(parts, dtype=np.int64)
    )


def _axis_faults(module: Module, piece: Piece, place: str) -> Iterator[InputError]:
    """Yield hinge axes that do not suit the kind of joint, and joints that miss the body."""
    kind, hinges = piece.joint_kind, f"{place}.joint.hinges"
    along = piece.exit_axes[:, 0]
    expected = 2 if kind == "universal" else 1
    if len(piece.axes) != expected:
        yield _fault(
            "wrong-count",
            hinges,
            f"got {len(piece.axes)} hinges, expected {expected} for the joint kind {kind!r}.",
        )
    elif kind == "twist" and abs(piece.axes[0] @ along) < 1.0 - TOUCHING:
        yield _fault(
            "axes-miss",
            f"{hinges}[0].axis",
            f"got a twist whose axis is {_angle_deg(piece.axes[0], along):.3g}° off the line of "
            "the link, expected [1, 0, 0], the x axis of the exit; turn the axis, or call the "
            "joint a hinge.",
        )
    elif kind == "universal" and abs(piece.axes[0] @ piece.axes[1]) > TOUCHING:
        yield _fault(
            "axes-miss",
            hinges,
            f"got two axes at an angle of {_angle_deg(*piece.axes):.3g}°, expected a right angle: "
            "the second hinge would not turn the module in a new direction; correct one axis.",
        )
    for end, point in (("entry", piece.entry), ("exit", piece.exit)):
        gap = min(_outside(part.corners, part.face_normals, point) for part in piece.parts)
        if gap > MAX_JOINT_GAP:
            yield _fault(
                "axes-miss",
                f"{place}.{end}.at",
                f"got a joint that is {gap:.3g} pitches away from the body, expected at most "
                f"{MAX_JOINT_GAP:g}; move the joint, or the corners.",
            )


def _angle_deg(a: Array, b: Array) -> float:
    """Return the angle of two lines, in degrees."""
    return float(np.rad2deg(np.arccos(min(1.0, abs(float(a @ b))))))


def _outside(corners: Array, normals: Array, point: Array) -> float:
    """Return how far a point is beyond the farthest face plane of a body; a lower bound."""
    heights, at = corners @ normals.T, normals @ point
    return float(np.maximum(at - heights.max(axis=0), heights.min(axis=0) - at).max())


def _pattern_faults(module: Module) -> Iterator[InputError]:
    """Yield the pieces that no module of the chain is."""
    if unused := sorted(set(range(len(module.pieces))) - set(module.pattern)):
        name = module.pieces[unused[0]].name
        yield _fault(
            "unused-piece",
            "pattern",
            f"got a pattern without the piece {name!r}, expected every piece in it; add the "
            "piece to the pattern, or remove it from the file.",
        )


class _Pair(NamedTuple):
    """Two linked pieces, and the first module of the pattern that is the first of them."""

    before: int
    behind: int
    module: int


def _linked_pairs(module: Module) -> list[_Pair]:
    """Return the different pairs of pieces that follow each other in a chain."""
    pattern = (
        module.pattern if module.rest_rad is not None else (*module.pattern, module.pattern[0])
    )
    firsts: dict[tuple[int, int], int] = {}
    for k, pair in enumerate(pairwise(pattern)):
        firsts.setdefault(pair, k)
    return [_Pair(*pair, k) for pair, k in firsts.items()]


def _separation(module: Module, pair: _Pair, angles_rad: Array, size: float) -> float:
    """Return the separation of two linked modules at some hinge angles, in pitches."""
    before, behind = module.pieces[pair.before], module.pieces[pair.behind]
    rotation = np.eye(3)
    for axis, angle in zip(before.axes, angles_rad, strict=True):
        rotation = rotation @ axis_rotation(axis, float(angle))
    rotation = rotation @ before.exit_axes @ behind.entry_axes.T
    gap = before.exit - rotation @ behind.entry
    hull = module.hull._replace(kinds=np.array([pair.before, pair.behind], dtype=np.int64))
    return pair_separation(gap, np.eye(3), rotation, hull, size, 1.0, 0, 1)


def _overlap_at_rest(module: Module, pair: _Pair) -> InputError | None:
    apart = _separation(module, pair, np.zeros(module.hinges_per_joint), 1.0)
    if apart >= -TOUCHING:
        return None
    names = [module.pieces[k].name for k in (pair.before, pair.behind)]
    return _fault(
        "linked-overlap",
        f"pieces[{pair.behind}].entry",
        f"got a piece {names[1]!r} that reaches {-apart:.3g} pitches into the piece {names[0]!r} "
        "before it at angle zero, expected none to reach into the other; move the entry or the "
        "exit, make a part smaller, or state linked_overlap if the joint is hidden in both.",
    )


def _unreachable_stops(module: Module, pair: _Pair) -> Iterator[InputError]:
    """Yield the stops that a hinge cannot reach because the two linked modules collide before."""
    ranges = module.pieces[pair.before].ranges_rad
    for hinge, (low, high) in enumerate(ranges):
        for stop in (low, high) if np.isfinite(low) else (np.pi,):
            reached = _reached(module, pair, hinge, float(stop))
            if reached is None:
                continue
            name = module.pieces[pair.before].name
            turn = f"from {np.rad2deg(low):g}° to {np.rad2deg(high):g}°"
            yield _fault(
                "unreachable-stop",
                f"pieces[{pair.before}].joint.hinges[{hinge}].range_deg",
                f"got a hinge that turns {'freely' if np.isinf(stop) or stop == np.pi else turn}, "
                f"but the pieces {name!r} and {module.pieces[pair.behind].name!r} collide at "
                f"{np.rad2deg(reached):.3g}°; give a smaller range, or cut the parts back.",
            )


def _reached(module: Module, pair: _Pair, hinge: int, stop: float) -> float | None:
    """Return the angle that a hinge reaches before a collision; None if it reaches its stop."""
    angles = np.zeros(module.hinges_per_joint)

    def collides(angle: float) -> bool:
        angles[hinge] = angle
        return _separation(module, pair, angles, DEFAULT_MODULE_SIZE) < -TOUCHING

    free = 0.0
    for angle in np.linspace(0.0, stop, STOP_STEPS + 1)[1:]:
        if collides(float(angle)):
            blocked = float(angle)
            break
        free = float(angle)
    else:
        return None
    for _ in range(HALVINGS):
        middle = (free + blocked) / 2.0
        free, blocked = (free, middle) if collides(middle) else (middle, blocked)
    return free


def _rest_faults(module: Module) -> Iterator[InputError]:
    """Yield the first two modules that lie in one another in the rest shape."""
    joints = len(module.pattern) - 1 - module.rigid_links
    if joints < 1:
        return
    try:
        Chain.from_angles(module, np.zeros(joints * module.hinges_per_joint))
    except InputError as error:
        template = error.template.replace("folded shape", "rest shape")
        yield InputError("rest-overlap", template, where="rest_deg", **error.values)
