"""Confirm why a fold failed from two files: the chain of modules is knotted, or blocks itself.

    python foldback_check_refusals.py plan.npz record.npz [--json]

Needs NumPy and foldback_check.py beside it, whose proof and bound of rounding it uses, and nothing
of foldback. docs/certificate.md states what is claimed. Exits with 3: refusal confirmed, 4:
confirmed for modules as the plan describes them, not foldback's, 1: not proved or not checked, 2:
no plan.

The record of a search that failed is proved like a plan: folded at first, no contact. Its
last frame then shows one of three things. BLOCKS: two parts overlap if no face and no two edges
give a separating axis; faces and edges of a part must be all that the hull of its corners has.
Edges parallel to 1e-6 are left out, so overlaps count from 1e-4 on. A hinge, or a group, that makes
modules overlap somewhere on its way cannot pass there by itself.
QUARTER TURNS: the record is the folded state alone, and each hinge makes modules overlap somewhere
on its way by a quarter turn, in each direction that its range allows.
KNOT: the line through all centres, lengthened at both ends and closed outside, is knotted. Look at
it along any direction and give a number to each arc, so that 2 over = before + after wherever one
passes under another (Fox). The matrix of these equations, less a row and a column, has the same
determinant up to sign whatever the direction; for the unknot 1. It is computed modulo a prime. A
view counts if nothing in it changes when every point moves by b, more than ROUNDING. An area of
sides p, q then changes by less than 4 b (p + q), a volume of sides p, q, r by 4 b (p + q + r)^2.
"""

import argparse
import itertools
import math
import sys

import numpy as np

if __package__:
    from foldback.foldback_check import (
        MODULES_AT_ONCE,
        OTHER_MODULE,
        SLIP,
        File,
        NotProved,
        Plan,
        answer,
        pair,
        parsed,
        prove,
        relative,
        require,
        show,
    )
else:  # a program of its own, beside the other
    from foldback_check import (
        MODULES_AT_ONCE,
        OTHER_MODULE,
        SLIP,
        File,
        NotProved,
        Plan,
        answer,
        pair,
        parsed,
        prove,
        relative,
        require,
        show,
    )

TOUCH, DEEP = 1e-9, 1e-4  # clearance of a record; least overlap that blocks
PRIME, CROSSINGS, VIEWS = 2**31 - 1, 1500, 8  # modulus; most crossings of a view; views of a knot
CLOSINGS = 64  # most ways to join the ends


class NotChecked(NotProved):
    """A reason that is no property of the shape."""


class Refused(Plan):
    """The motion of a search that failed, and the evidence of its reason."""

    def __init__(self, path, record):
        plan, file = File(path), File(record)
        text = parsed(*plan.read("plan"), int)
        certificate, ran = text["certificate"], text["explosion"]
        require(certificate["verified"] is False, "the plan does not fail")
        stops = [a.get("diagnosis") for a in text["attempts"] if ran and ran.items() <= a.items()]
        self.evidence = next((stop["evidence"] for stop in stops if stop), None) or {}
        kind = self.evidence.get("kind")
        if kind == "budget":
            raise NotChecked("this is a limit of foldback's search, not a property of the shape")
        require(kind in REASONS, "the plan gives no reason that can be checked")
        root, of = (0, "base_") if "first" in file else (text["root_module"], "root_")
        frames, _ = file.shape(of + "position", 2)
        place, turn = file.read(of + "position", frames, 3), file.read(of + "wxyz", frames, 4)
        self.root = root, place[-1], turn[-1]
        file.members[b"joint_names.npy"] = plan.members[b"joint_names.npy"]
        text["start"] = {"folded_rad": text["chain"]["folded_rad"]}
        size = self.evidence.get("module_size", certificate["module_size"])
        self.read(file, text, size, TOUCH, ends=False)


def require_all_sides(module):
    """Require that faces and edges of all parts are those of their hulls (BLOCKS)."""
    for part in (part for piece in module.pieces for part in piece):
        v = part.corners
        a, b, c = v[np.array([*itertools.combinations(range(len(v)), 3)]).T]
        n, size = np.cross(b - a, c - a), np.linalg.norm(np.cross(b - a, c - a), axis=1)
        n, a = n[size > 1e-9] / size[size > 1e-9, None], a[size > 1e-9]
        high = v @ n.T - (a * n).sum(1)
        outer = (high < 1e-9).all(0) | (high > -1e-9).all(0)
        n, on = n[outer], np.abs(high[:, outer]) < 1e-9  # faces, maybe often, and corners on them
        edges = [v[j] - v[i] for i, j in itertools.combinations(range(len(v)), 2)
                 if np.linalg.matrix_rank(n[on[i] & on[j]], 1e-6) > 1]
        for directions, known in (n, part.faces), (np.array(edges).reshape(-1, 3), part.edges):
            crossed = np.linalg.norm(np.cross(directions[:, None], known), axis=2)
            require(len(directions) and (crossed.min(1) < 1e-7).all(),
                    "modules whose separating axes are not known")


def stopped(module, evidence, middle, end, poses):
    """Require that two modules overlap as told, one before `middle`, one from there to `end`."""
    i, j = sorted(evidence["modules"])
    require(0 <= i < middle <= j < end and j - i >= module.apart, pair(i, j))
    pose = relative(poses[i], poses[j : j + 1])
    one, other = (module.pieces[module.piece[k % len(module.piece)]] for k in (i, j))
    deep = -min(max(part.gaps(body, pose, by_edges)[1].max() for by_edges in (False, True))
                for part in one for body in other)
    require(deep >= DEEP and abs(deep - evidence["overlap"]) <= 1e-6,
            f"{pair(i, j)} overlap by {deep:.9f}, the plan says {evidence['overlap']:.9f}")


def blocks(plan, evidence, _):
    """Prove that modules stop each bent hinge, and the group that would move next (BLOCKS)."""
    module, pad, turns, moves = plan.module, plan.pad, evidence["turns"], evidence["moves"]
    q = plan.angles(plan.frames - 1, 0, len(plan.folded))
    bend, first = evidence["bent_above_rad"], evidence["first_hinge"] + pad
    hinges = len(module.names)
    bent = first + np.flatnonzero(np.abs(q[first:]) > bend)
    require_all_sides(module)
    require(turns + moves and 0.0 < bend <= math.pi / 3 and first >= pad and
            np.abs(q - plan.folded)[:first].max(initial=0.0) <= 1e-5 and
            [turn["hinge"] + pad for turn in turns] == bent.tolist(), "other bent hinges")
    for slot, turn in zip(bent, turns, strict=True):
        angles, by = q.copy(), turn["turned_rad"]
        require(by * q[slot] < 0.0 and abs(by) <= math.radians(5.001), f"a turn by {by:.6f} rad")
        angles[slot] += by
        stopped(module, turn, slot // hinges + 1, plan.count, module.chain(angles))
    low, high = evidence["unit"] if moves else (0, 0)
    six = {(*way,) for way in [*np.eye(3), *-np.eye(3)]}
    require(not moves or 0 < low <= high == first // hinges and
            {(*move["direction"],) for move in moves} == six, "not all six directions")
    for move in moves:
        poses = module.chain(plan.folded)
        require(0.0 < move["moved"] <= 1.0, "a move of more than a pitch")
        poses[low:, 0] += np.multiply(move["direction"], move["moved"])
        stopped(module, move, low, high + 1, poses)
    return "; ".join([
        f"none of the {len(turns)} hinges bent by more than {bend:g} rad from module "
        f"{first // hinges + 1} on can straighten by itself"][: len(turns)] + [
        f"modules {low + 1} to {high + 1} as one cannot move by a pitch along any axis"
    ][: len(moves)])


def quarter_turns(plan, evidence, _):
    """Prove that modules stop each quarter turn of one hinge of the folded chain."""
    module, pad, turns, quarter = plan.module, plan.pad, evidence["turns"], math.pi / 2
    q, hinges = plan.folded, len(module.names)
    off = np.abs(plan.angles(plan.frames - 1, 0, len(q)) - q).max()
    require_all_sides(module)
    require(off <= SLIP, f"the search has left the folded state by {off:.6f} rad")
    all_turns = [(slot, sign) for slot in range(pad, len(q)) for sign in (-1, 1)
                 if plan.ranges[slot, 0] <= q[slot] + sign * quarter <= plan.ranges[slot, 1]]
    require([(turn["hinge"] + pad, np.sign(turn["turned_rad"])) for turn in turns] == all_turns,
            f"other turns than the {len(all_turns)} that the hinges' ranges allow")
    batch, start = max(1, MODULES_AT_ONCE // plan.count), np.eye(4, 3, -1)[:, :, None]
    for at in range(0, len(turns), batch):
        part, slots = turns[at : at + batch], [slot for slot, _ in all_turns[at : at + batch]]
        by = np.array([turn["turned_rad"] for turn in part])
        require(np.abs(by).max() <= quarter, "a turn by more than 90 degrees")
        angles = np.repeat(q[:, None], len(part), axis=1)
        angles[slots, range(len(part))] += by
        poses = module.poses(angles.reshape(-1, hinges, len(part)), np.repeat(start, len(part), 2))
        for k, (slot, turn) in enumerate(zip(slots, part, strict=True)):
            stopped(module, turn, slot // hinges + 1, plan.count, poses[:, k])
    return (f"none of the {len(turns)} quarter turns of its {len(q) - pad} hinges, each by itself, "
            "is free")


def crossings(p, b):
    """Return (over, under, off) of a closed polygon's crossings, seen along the third axis.

    Places are edges plus fractions. None if anything may change when vertices move by b.
    """
    e, rows = np.roll(p, -1, axis=0) - p, [np.empty((0, 3))]
    low, high, size = np.minimum(p, p + e) - b, np.maximum(p, p + e) + b, np.linalg.norm(e, axis=1)
    for i in range(len(p) - 2):
        j = np.arange(i + 2, len(p) - (i == 0))
        j = j[((low[j] < high[i]) & (low[i] < high[j]))[:, :2].all(1)]
        gap = p[j] - p[i]
        sides = (e[i], gap), (e[i], gap + e[j]), (gap, e[j]), (gap - e[i], e[j])
        area = np.array([u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0] for u, v in sides])
        scale = size[i] + size[j] + np.linalg.norm(gap, axis=1)
        side = np.where(np.abs(area) > 4 * b * scale, np.sign(area), 0.0)
        side_i, side_j = side[0] * side[1], side[2] * side[3]
        area, scale, j = (v[..., (side_i < 0.0) & (side_j < 0.0)] for v in (area, scale, j))
        span = area[2] - area[3]
        s, t = area[2] / span, area[0] / (area[0] - area[1])
        above = p[i, 2] + s * e[i, 2] - p[j, 2] - t * e[j, 2]
        if (~((side_i > 0.0) | (side_j > 0.0))).sum() > len(j) or not (
                np.abs(above * span) > 4 * b * scale**2).all():
            return None
        two = np.where(above > 0.0, (i + s, j + t), (j + t, i + s))
        rows.append(np.column_stack([*two, 4 * b * scale / np.abs(span)]))
    rows = np.concatenate(rows)
    apart = np.diff(np.sort(rows[:, :2], axis=None)).min(initial=1.0)
    return rows if apart > 2 * rows[:, 2].max(initial=0.0) else None


def determinant(polygon, b):
    """Return the determinant of a closed polygon's knot, modulo PRIME and up to sign (KNOT)."""
    turns = (np.linalg.qr(np.random.default_rng(k).normal(size=(3, 3)))[0] for k in range(VIEWS))
    clear = [view for turn in turns if (view := crossings(polygon @ turn, b)) is not None]
    require(clear, "no view of the line is clear")
    over, under, _ = min(clear, key=len).T
    require(len(over) <= CROSSINGS, f"a view of the line has {len(over)} crossings")
    ends, product = np.sort(under), 1  # an arc ends below another one
    identity = np.eye(len(over), dtype="i8")
    arc, at = np.searchsorted(ends, under), np.searchsorted(ends, over) % len(over)
    rows = (2 * identity[at] - identity[arc] - identity[(arc + 1) % len(over)])[1:, 1:] % PRIME
    while len(rows):
        top = rows[:, 0].argmax()
        first = int(rows[top, 0])
        by, product = rows[:, :1] * pow(first, PRIME - 2, PRIME) % PRIME, product * first % PRIME
        rows = np.delete((rows - by * rows[top]) % PRIME, top, 0)[:, 1:]
    return min(product, PRIME - product)


def away(points, a, b):
    """Return the least distance of points from the way from a to b."""
    share = ((points - a) @ (b - a) / max((b - a) @ (b - a), 1e-300)).clip(0.0, 1.0)
    return np.linalg.norm(points - a - share[:, None] * (b - a), axis=1).min()


def knot(plan, evidence, b):
    """Prove that the line through all centres is knotted, its ends led out and joined (KNOT)."""
    (root, place, (w, *v)), values = plan.root, set()
    poses = plan.module.chain(plan.angles(plan.frames - 1, 0, len(plan.folded)))
    spin = np.cross(v, np.eye(3))
    turn = np.eye(3) + 2 * (w * spin + spin @ spin) / (w * w + np.dot(v, v))
    x = relative(poses[root], poses)[:, 0] @ turn + place
    middle, ends = x.mean(0), np.linalg.norm(x[-1] - x[0])
    radius = np.linalg.norm(x - middle, axis=1).max()
    require(0 < len(evidence["closings"]) <= CLOSINGS, "no ways to join the ends, or too many")
    for corners in evidence["closings"]:
        c = np.array(corners, float).reshape(-1, 3)
        line = np.concatenate([x, c])
        require(len(c) in (0, 2, 3) and np.abs(line).max() < 1e5, "ends that are joined otherwise")
        free = ends <= 1.1 if not len(c) else (
            min(away(x[:-1], x[-1], c[0]), away(x[1:], x[0], c[-1])) >= 0.5 and
            all(away(middle[None], *two) >= radius for two in itertools.pairwise(c)))
        e = np.roll(line, -1, axis=0) - line
        e /= np.linalg.norm(e, axis=1, keepdims=True)
        straight = ((e * np.roll(e, -1, axis=0)).sum(1) > -0.999).all()
        require(free and straight, "an end without a free way out")
        values.add(determinant(line, b))
    require(len(values) == 1 and 1 not in values, f"no knot: determinant {values}")
    value, remainder = evidence["determinant"], values.pop()
    require(value is None or type(value) is int and remainder in (value % PRIME, -value % PRIME),
            f"determinant {remainder}")
    small = type(value) is int and abs(value) < PRIME
    size = abs(value) if small else remainder
    return (f"the line through all centres is knotted (determinant {size}"
            f"{'' if small else f' modulo {PRIME}'}), its "
            "ends being led out along free straight lines and joined outside")


REASONS = {"knot": knot, "blocks": blocks, "quarter_turns": quarter_turns}


def check(path, record):
    """Return what was confirmed of a refusal, or why it was not (`foldback_check.answer`)."""

    def work(result):
        try:
            plan = Refused(path, record)
            proof = prove(plan, result)
            b = proof.chain_rounding + 1e-9
            because = REASONS[plan.evidence["kind"]](plan, plan.evidence, b)
            limit = OTHER_MODULE * (not plan.is_usual)
            result |= {"verdict": "refusal confirmed" + f", but {limit}" * bool(limit),
                      "because": because, "reason": limit, "limits": [limit] * bool(limit)}
        except NotChecked as error:
            result |= {"verdict": "not checked", "reason": str(error)}

    return answer(path, work)


SAYS = """{verdict}: {modules} modules of size {size:g} ({module}), {frames} frames.
They begin folded and never touch. At last, {because}.
That no other motion unfolds them is not claimed. {seconds:.1f} s."""


def main(arguments=None):
    """Check a refusal and print the result."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("plan", help="plan.npz of a fold that failed")
    parser.add_argument("record", help="its record.npz")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    options = parser.parse_args(arguments)
    try:
        result = check(options.plan, options.record)
    except ValueError as error:
        print(f"no plan: {error}", file=sys.stderr)
        return 2
    show(result, options.json, SAYS)
    return 1 if result["verdict"].startswith("not ") else 4 if result["limits"] else 3


if __name__ == "__main__":
    sys.exit(main())
