"""Block evidence: a check that modules block each turn and move in the evidence of a failure.

Overlaps are found by separating axes in plain NumPy, apart from the compiled checks.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.chain.polyhedron import Polyhedron
from foldback.planner.chain.rotations import QUARTER_RAD
from foldback.planner.motion.failure_schemas import BlockFigures, QuarterTurnFigures, TurnFigures
from foldback.planner.plan.value_differences import Differences

MAX_BLOCKED_TURN_RAD: Final = float(np.deg2rad(5.0))
"""Maximum turn, in rad, by which the evidence of a jam may show that a hinge collides. A hinge that
can turn further counts as free."""
MAX_UNREPORTED_BEND_RAD: Final = float(np.deg2rad(60.0))
"""Maximum bend, in rad, of hinges that the evidence of a jam may leave out as straight; evidence
that leaves out more is refused."""
MAX_BLOCKED_MOVE_PITCH: Final = 1.0
"""Maximum displacement, in pitches, at which a group of modules must collide for the stored
evidence that a chain is jammed to be accepted. With a larger one the evidence is refused, as a
group that can move by a whole cell counts as free."""
SINGLE_PRECISION_ANGLE_RAD: Final = 1e-5
"""Maximum difference, in rad, between the angles of the part of a chain that a jam's evidence
states as still folded and the folded angles: the record is in single precision."""
AXIS_ROUNDING: Final = 1e-9
"""Tolerance for rounding where a jam's evidence is checked: an angle (rad) or overlap (pitches) up
to it counts as 0, and so does the squared length of a cross product, so that parallel edges give no
separating axis."""


def blocks_differ(
    chain: Chain, angles_rad: Array, stated: BlockFigures, module_size: float
) -> Differences:
    """Yield the differences between reported and computed blocks.

    Args:
        chain: The chain.
        angles_rad: (J,) hinge angles where the explosion stopped, rad.
        stated: The evidence.
        module_size: Module size at which the explosion keeps clear.
    """
    first = stated["first_hinge"]
    if stated["module_size"] != module_size:
        yield f"module_size: got {stated['module_size']:g}, expected {module_size:g}"
    if stated["bent_above_rad"] > MAX_UNREPORTED_BEND_RAD:
        yield (
            f"bent_above_rad: got {stated['bent_above_rad']:.3g}, expected at most "
            f"{MAX_UNREPORTED_BEND_RAD:.3g}"
        )
    if not np.allclose(
        angles_rad[:first], chain.folded_rad[:first], rtol=0.0, atol=SINGLE_PRECISION_ANGLE_RAD
    ):
        yield f"first_hinge: got {first}, expected a hinge before which all hinges are folded"
    bent = np.flatnonzero(np.abs(angles_rad) > stated["bent_above_rad"])
    expected = bent[bent >= first].tolist()
    if [turn["hinge"] for turn in stated["turns"]] != expected:
        yield (
            f"turns: got {len(stated['turns'])} turns, expected {len(expected)}: one for each "
            "bent hinge, in the order of the hinges"
        )
        return
    if not stated["turns"] and not stated["moves"]:
        yield "turns and moves: got none, expected at least one blocked turn or move"
    before = forward_kinematics(chain.module, angles_rad)
    for turn in stated["turns"]:
        hinge, turned = turn["hinge"], turn["turned_rad"]
        if turned * angles_rad[hinge] >= 0.0 or abs(turned) > MAX_BLOCKED_TURN_RAD + AXIS_ROUNDING:
            max_turn = MAX_BLOCKED_TURN_RAD
            yield (
                f"hinge {hinge}: got a turn of {turned:.3g} rad, expected a turn of at most "
                f"{max_turn:.3g} rad towards the straight position"
            )
        yield from _turn_differs(chain, angles_rad, before, turn, module_size)
    yield from _moves_differ(chain, stated, module_size)


def quarter_turns_differ(
    chain: Chain, angles_rad: Array, stated: QuarterTurnFigures, module_size: float
) -> Differences:
    """Yield the differences between reported and computed overlaps in quarter turns.

    Args:
        chain: The chain.
        angles_rad: (J,) hinge angles where the search for turns stopped, rad.
        stated: The evidence.
        module_size: Module size of the fold.
    """
    if stated["module_size"] != module_size:
        yield f"module_size: got {stated['module_size']:g}, expected {module_size:g}"
    off = float(np.abs(angles_rad - chain.folded_rad).max(initial=0.0))
    if off > SINGLE_PRECISION_ANGLE_RAD:
        yield f"the search has left the folded state: a hinge is off by {off:.3g} rad"
    low, high = chain.stops_rad().T
    expected = [
        (hinge, sign)
        for hinge, angle in enumerate(chain.folded_rad.tolist())
        for sign in (-1, 1)
        if low[hinge] <= angle + sign * QUARTER_RAD <= high[hinge]
    ]
    turns = stated["turns"]
    if [(turn["hinge"], np.sign(turn["turned_rad"])) for turn in turns] != expected:
        yield (
            f"turns: got {len(turns)} turns, expected {len(expected)}: one for each quarter turn "
            "within a hinge's range, in the order of the hinges, negative ones first"
        )
        return
    before = forward_kinematics(chain.module, chain.folded_rad)
    for turn in turns:
        if abs(turn["turned_rad"]) > QUARTER_RAD:
            yield (
                f"hinge {turn['hinge']}: got a turn of {turn['turned_rad']:.3g} rad, expected one "
                f"of at most {QUARTER_RAD:.3g} rad"
            )
        yield from _turn_differs(chain, chain.folded_rad, before, turn, module_size)


def _turn_differs(
    chain: Chain, angles_rad: Array, before: Poses, turn: TurnFigures, module_size: float
) -> Differences:
    """Yield the reasons why the modules of a turn are no obstacle to it as reported."""
    hinge, (i, j) = turn["hinge"], sorted(turn["modules"])
    name = f"hinge {hinge}"
    module = chain.module_before(hinge)
    if turn["module"] != module or not i <= module < j:
        yield f"{name}: got modules {i} and {j}, expected one on each side of module {module}"
    now = angles_rad.copy()
    now[hinge] += turn["turned_rad"]
    poses = forward_kinematics(chain.module, now)
    yield from _overlap_differs(chain, poses, before, (i, j), module_size, turn["overlap"], name)


def _moves_differ(chain: Chain, stated: BlockFigures, module_size: float) -> Differences:
    """Yield the differences of the moves of a unit, which must be blocked in all directions."""
    if not stated["moves"]:
        return
    axes = np.concatenate([np.eye(3), -np.eye(3)]).astype(int).tolist()
    directions = [move["direction"] for move in stated["moves"]]
    if sorted(directions) != sorted(axes):
        yield f"moves: got the directions {directions}, expected each of the six directions once"
    last = chain.module_before(stated["first_hinge"])
    if stated["unit"] is None or stated["unit"][1] != last:
        yield f"unit: got {stated['unit']}, expected a range whose last module is {last}"
        return
    low, high = stated["unit"]
    folded = forward_kinematics(chain.module, chain.folded_rad)
    for move in stated["moves"]:
        (a, b), moved = move["modules"], move["moved"]
        name = f"direction {move['direction']}"
        if not (low <= a <= high and 0 <= b < low):
            yield (
                f"{name}: got modules {a} and {b}, expected one module from {low} to {high} "
                f"and one before module {low}"
            )
        if not 0.0 < moved <= MAX_BLOCKED_MOVE_PITCH:
            max_move = MAX_BLOCKED_MOVE_PITCH
            yield f"{name}: got a move of {moved:g} pitch, expected at most {max_move:g} pitch"
        positions = folded.positions.copy()
        positions[low:] += moved * np.array(move["direction"])
        poses = Poses(positions=positions, rotations=folded.rotations)
        yield from _overlap_differs(
            chain, poses, folded, (b, a), module_size, move["overlap"], name
        )


def _overlap_differs(
    chain: Chain,
    poses: Poses,
    before: Poses,
    pair: tuple[int, int],
    module_size: float,
    stated: float,
    name: str,
) -> Differences:
    """Yield the reasons why two modules are no obstacle to each other as reported."""
    i, j = pair
    if not 0 <= i < j < len(chain) or j - i < chain.module.apart:
        yield f"{name}: got modules {i} and {j}, expected two modules that are not linked"
        return
    depth = overlap(chain, poses, i, j, module_size)
    if not (depth > 0.0 and abs(depth - stated) <= 1e-6):  # pitches: rounding
        yield (
            f"{name}: modules {i} and {j} overlap by {depth:.3g} pitch, expected {stated:.3g} pitch"
        )
    if overlap(chain, before, i, j, module_size) > AXIS_ROUNDING:
        yield f"{name}: modules {i} and {j} already overlap before the motion"


def overlap(chain: Chain, poses: Poses, i: int, j: int, module_size: float) -> float:
    """Return the depth of the overlap of two modules, pitches; negative if they are apart.

    It is that of the two parts that lie deepest in one another.
    """
    one, other = (
        [
            part.placed(poses.positions[k], poses.rotations[k], size=module_size)
            for part in chain.module.piece(k).parts
        ]
        for k in (i, j)
    )
    return max(_overlap_of_parts(p, q) for p in one for q in other)


def _overlap_of_parts(p: Polyhedron, q: Polyhedron) -> float:
    """Return the depth of the overlap of two convex parts; negative if they are apart."""
    products = np.cross(p.edge_directions[:, None], q.edge_directions[None]).reshape(-1, 3)
    axes = np.concatenate([p.face_normals, q.face_normals, products])
    lengths = np.linalg.norm(axes, axis=1)
    axes = axes[lengths > AXIS_ROUNDING**0.5] / lengths[lengths > AXIS_ROUNDING**0.5, None]
    a, b = p.corners @ axes.T, q.corners @ axes.T
    deep = np.minimum(a.max(axis=0) - b.min(axis=0), b.max(axis=0) - a.min(axis=0))
    return float(deep.min())
