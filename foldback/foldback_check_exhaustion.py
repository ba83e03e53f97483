"""Prove from a file alone that no single turns of joints lead from a figure to its goal.

    python foldback_check_exhaustion.py exhaustion.json [--json]

Needs NumPy, and nothing of foldback. The file (foldback-exhaustion/1) describes a module as in
foldback-module/1, a chain, and some consecutive modules of it, the *part*. It lists states of the
part, that is angles of its joints in steps, and what follows when one joint turns by one step
either way: a state of the list, or a stop, or two modules and the share of the turn at which one
lies in the other. Proved is that

- the first state is that of the figure, and the goal is not in the list;
- each turn of each state is listed; where it leads to a state, that is the one that follows; and
  where two modules are named, they overlap by more than TOLERANCE in every direction at that place.

So no sequence of single turns leads the part out of the list, at full size. What turns the whole
chain makes, its part makes alone, so none leads the chain to the goal. Lengths are in pitches. At
angle 0 the frame of the next module's entry lies on that of the exit; a joint turns about its axis
in the frame of the exit. Two convex bodies overlap if they do so along each normal of a face and
each cross product of two edges; these are found here from the corners alone. Exits with 0: proved,
1: not proved, 2: no such file.
"""

import argparse
import itertools
import json
import sys

import numpy as np

TOLERANCE = 1e-6  # pitches; far above rounding errors, which are below 1e-12 here
MAX_BYTES, MAX_STATES, MAX_MODULES, MAX_CORNERS, MAX_PARTS = 1 << 28, 2_000_000, 1000, 32, 16
ROWS_AT_ONCE, NUMBERS_AT_ONCE = 4000, 1 << 22


class NotProved(Exception):
    """The file is no proof; says why."""


class Unreadable(Exception):
    """The file is none of this format; says why."""


def rotation(axis, angles):
    """Return (B, 3, 3) rotations about a unit axis."""
    x, y, z = axis
    k = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angles)[:, None, None], np.cos(angles)[:, None, None]
    return np.eye(3) + s * k + (1.0 - c) * (k @ k)


def unit(vector):
    """Return a vector of length 1."""
    vector = np.array(vector, float)
    length = np.linalg.norm(vector)
    if vector.shape != (3,) or not 1e-6 < length < 1e6:
        raise Unreadable("a direction is not three numbers")
    return vector / length


def frame(end):
    """Return the axes (columns) and the centre of an entry or exit."""
    x, y = unit(end.get("x", [1, 0, 0])), unit(end.get("y", [0, 1, 0]))
    at = np.array(end["at"], float)
    if abs(x @ y) > 1e-6 or at.shape != (3,):
        raise Unreadable("the axes of a frame are not at right angles")
    return np.stack([x, y, np.cross(x, y)], 1), at


class Body:
    """A convex body: corners, and unit vectors along its edges and across its faces."""

    def __init__(self, corners):
        self.corners = c = np.array(corners, float)
        if c.ndim != 2 or c.shape[1] != 3 or not 4 <= len(c) <= MAX_CORNERS:
            raise Unreadable("a part is not 4 to 32 corners")
        if not np.isfinite(c).all() or np.abs(c).max() > 100:
            raise Unreadable("a corner is too far away")
        i, j, k = np.array(list(itertools.combinations(range(len(c)), 3))).T
        normals = np.cross(c[j] - c[i], c[k] - c[i])
        lengths = np.linalg.norm(normals, axis=1)
        normals, i = normals[lengths > 1e-9] / lengths[lengths > 1e-9, None], i[lengths > 1e-9]
        heights = normals @ c.T - np.einsum("nk,nk->n", normals, c[i])[:, None]
        outer = (heights < 1e-9).all(1) | (heights > -1e-9).all(1)
        faces = {tuple(row) for row in (np.abs(heights[outer]) < 1e-9).tolist()}
        self.faces = different(normals[outer])
        pairs = itertools.combinations(range(len(c)), 2)
        edges = [c[b] - c[a] for a, b in pairs if sum(f[a] and f[b] for f in faces) > 1]
        if len(faces) < 4 or len(edges) < 6:
            raise Unreadable("a part has no volume")
        self.edges = different(np.array([unit(edge) for edge in edges]))


def different(directions):
    """Return unit vectors of which no two are parallel."""
    lines = []
    for d in directions:
        if all(np.linalg.norm(np.cross(d, other)) > 1e-9 for other in lines):
            lines.append(d)
    return np.array(lines)


class Part:
    """Consecutive modules of a chain, and the steps of their joints."""

    def __init__(self, module, first, count):
        if module.get("format") != "foldback-module/1":
            raise Unreadable("the module is not foldback-module/1")
        named = {piece["name"]: piece for piece in module["pieces"]}
        if len(named) > MAX_PARTS or any(len(p["parts"]) > MAX_PARTS for p in named.values()):
            raise Unreadable("a module has too many pieces or parts")
        order = [named[name] for name in module["pattern"]]
        pieces = [order[(first + k) % len(order)] for k in range(count)]
        bodies = {n: [Body(p["corners"]) for p in v["parts"]] for n, v in named.items()}
        self.bodies = [bodies[piece["name"]] for piece in pieces]
        self.apart = 2 if module.get("linked_overlap") else 1
        self.entries = [frame(piece["entry"]) for piece in pieces]
        self.exits = [frame(piece["exit"]) for piece in pieces]
        rest = module.get("rest_deg") or [0.0]
        self.hinges = []  # link, axis in the frame of the exit, rest angle, step, range
        for k in range(count - 1):
            if first + k < module.get("rigid_links", 0):
                continue
            joint = pieces[k]["joint"]
            step = float(joint["step_deg"])
            if not 0.0 < step <= 180.0:
                raise Unreadable("a joint has no step")
            for h in joint["hinges"]:
                at_rest = float(rest[(first + k) % len(rest)])
                self.hinges.append((k, unit(h["axis"]), at_rest, step, h.get("range_deg")))

    def after(self, state, hinge, change):
        """Return the state after a turn by one step; None beyond a stop."""
        *_, rest, step, ends = self.hinges[hinge]
        level = state[hinge] + change
        if ends is None:
            if abs(360.0 / step - round(360.0 / step)) > 1e-9:
                raise Unreadable("a full turn is no whole number of steps")
            level %= round(360.0 / step)
        elif not ends[0] - rest - 1e-6 <= level * step <= ends[1] - rest + 1e-6:
            return None
        return (*state[:hinge], level, *state[hinge + 1 :])

    def poses(self, angles_deg):
        """Return (B, n, 3, 3) axes and (B, n, 3) places for (B, J) angles."""
        rows = len(angles_deg)
        axes, place = np.tile(np.eye(3), (rows, 1, 1)), np.zeros((rows, 3))
        all_axes, all_places = [axes], [place]
        for link in range(len(self.exits) - 1):
            turn, at = self.exits[link]
            place = place + axes @ at
            axes = axes @ turn
            for number, (k, axis, rest, *_) in enumerate(self.hinges):
                if k == link:
                    axes = axes @ rotation(axis, np.radians(angles_deg[:, number] + rest))
            turn, at = self.entries[link + 1]
            axes = axes @ turn.T
            place = place - axes @ at
            all_axes.append(axes)
            all_places.append(place)
        return np.stack(all_axes, 1), np.stack(all_places, 1)

    def rows_at_once(self, i, j):
        """Return the number of poses of two modules that are compared at once."""
        bodies = self.bodies[i] + self.bodies[j]
        edges, corners = (max(len(getattr(b, k)) for b in bodies) for k in ("edges", "corners"))
        return max(1, NUMBERS_AT_ONCE // (edges * edges * corners))

    def overlap(self, i, j, axes, places):
        """Return (B,) how far modules i and j overlap, pitches; negative where they are apart."""
        deepest = np.full(len(axes), -np.inf)
        r, gap = np.swapaxes(axes[:, i], 1, 2) @ axes[:, j], places[:, j] - places[:, i]
        gap = np.einsum("bkm,bk->bm", axes[:, i], gap)  # all as module i sees it
        for a, b in itertools.product(self.bodies[i], self.bodies[j]):
            edges = b.edges @ np.swapaxes(r, 1, 2)
            crosses = np.cross(a.edges[None, :, None], edges[:, None]).reshape(len(r), -1, 3)
            lengths = np.linalg.norm(crosses, axis=2, keepdims=True)
            crosses = np.where(lengths > 1e-7, crosses / np.maximum(lengths, 1e-7), [0.0, 0.0, 0.0])
            own = np.broadcast_to(a.faces, (len(r), *a.faces.shape))
            along = np.concatenate([own, b.faces @ np.swapaxes(r, 1, 2), crosses], 1)
            one = along @ a.corners.T
            other = along @ (b.corners @ np.swapaxes(r, 1, 2) + gap[:, None]).swapaxes(1, 2)
            depths = np.minimum(one.max(2) - other.min(2), other.max(2) - one.min(2))
            depths[(along == 0.0).all(2)] = np.inf  # edges that are parallel
            deepest = np.maximum(deepest, depths.min(1))
        return deepest


def whole(value, low, high, what):
    """Return a whole number in a range."""
    if type(value) is not int or not low <= value <= high:
        raise Unreadable(f"{what}: got {str(value)[:40]!a}")
    return value


def read(path):
    """Return the values of a file."""
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)
        if len(data) > MAX_BYTES:
            raise Unreadable("the file is too large")
        values = json.loads(data)
    except (OSError, ValueError, RecursionError) as error:
        raise Unreadable(f"the file cannot be read: {str(error)[:80]!a}") from error
    if not isinstance(values, dict) or values.get("format") != "foldback-exhaustion/1":
        raise Unreadable("the file is not foldback-exhaustion/1")
    return values


def prove(values):
    """Prove what a file claims; return the figures of the proof."""
    modules = whole(values["modules"], 2, MAX_MODULES, "modules")
    first = whole(values["part"]["first"], 0, modules - 2, "first module of the part")
    count = whole(values["part"]["modules"], 2, modules - first, "modules of the part")
    chain, part = Part(values["module"], 0, modules), Part(values["module"], first, count)
    begin = sum(k < first for k, *_ in chain.hinges)
    hinges = len(part.hinges)
    for name in ("figure", "goal"):
        if len(values[name]) != len(chain.hinges):
            raise Unreadable(f"{name}: not one number for each of {len(chain.hinges)} hinges")
        for level in values[name]:
            whole(level, -1000, 1000, name)
    figure, goal = (tuple(values[name][begin : begin + hinges]) for name in ("figure", "goal"))
    states = [tuple(whole(level, -1000, 1000, "level") for level in s) for s in values["states"]]
    if not 1 <= len(states) <= MAX_STATES or any(len(s) != hinges for s in states):
        raise NotProved("the states do not have one level for each hinge")
    if len(set(states)) < len(states):
        raise NotProved("a state is listed twice")
    same = part_levels(part)
    listed = [same(state) for state in states]
    if listed[0] != same(figure):
        raise NotProved("the first state is not that of the figure")
    if same(goal) in set(listed):
        raise NotProved("the goal is among the states")
    if len(values["turns"]) != len(states):
        raise NotProved("the turns of some states are not listed")
    blocked = []
    for number, (state, rows) in enumerate(zip(states, values["turns"], strict=True)):
        if len(rows) != hinges or any(len(row) != 2 for row in rows):
            raise NotProved(f"state {number + 1}: some turns are not listed")
        for hinge, row in enumerate(rows):
            for change, leads in zip((-1, 1), row, strict=True):
                after = part.after(state, hinge, change)
                where = f"state {number + 1}, hinge {hinge + 1}"
                if isinstance(leads, list):
                    blocked.append((where, state, hinge, change, *evidence(leads, first, count)))
                elif leads is None:
                    if after is not None:
                        raise NotProved(f"{where}: there is no stop")
                elif after is None or listed[whole(leads, 0, len(states) - 1, where)] != same(
                    after
                ):
                    raise NotProved(f"{where}: the turn leads to another state")
    check_overlaps(part, blocked)
    return {
        "states": len(states),
        "modules": modules,
        "first_module": first,
        "part_modules": count,
        "turns": 2 * hinges * len(states),
        "blocked": len(blocked),
    }


def part_levels(part):
    """Return a function that gives states without full turns."""
    full = [round(360.0 / step) if ends is None else 0 for *_, step, ends in part.hinges]
    return lambda state: tuple(k % n if n else k for k, n in zip(state, full, strict=True))


def evidence(leads, first, count):
    """Return the two modules, counted from the part's first, and the share of the turn."""
    i, j, share = leads
    i, j = (whole(k, first, first + count - 1, "modules that meet") - first for k in (i, j))
    if type(share) not in (int, float) or not 0.0 <= share <= 1.0:
        raise Unreadable(f"share of a turn: got {str(share)[:40]!a}")
    return i, j, float(share)


def check_overlaps(part, blocked):
    """Refuse a turn at which the modules that are named do not overlap."""
    steps = np.array([step for *_, step, _ in part.hinges])
    for begin in range(0, len(blocked), ROWS_AT_ONCE):
        rows = blocked[begin : begin + ROWS_AT_ONCE]
        angles = np.array([row[1] for row in rows], float) * steps
        for angle, (_, _, hinge, change, _, _, share) in zip(angles, rows, strict=True):
            angle[hinge] += change * share * steps[hinge]
        axes, places = part.poses(angles)
        pairs = np.array([row[4:6] for row in rows])
        for i, j in np.unique(pairs, axis=0).tolist():
            at = np.flatnonzero((pairs == (i, j)).all(1))
            if abs(i - j) < part.apart:
                raise NotProved(f"{rows[at[0]][0]}: linked modules may overlap")
            count = part.rows_at_once(i, j)
            for some in np.split(at, range(count, len(at), count)):
                depths = part.overlap(i, j, axes[some], places[some])
                if not (depths > TOLERANCE).all():
                    worst = int(depths.argmin())
                    raise NotProved(f"{rows[some[worst]][0]}: the modules do not overlap")


def check(path):
    """Return the verdict on a file as JSON values."""
    try:
        return {"verdict": "proved", "reason": None, **prove(read(path))}
    except NotProved as error:
        return {"verdict": "not proved", "reason": str(error)}
    except Unreadable as error:
        return {"verdict": "unreadable", "reason": str(error)}
    except (KeyError, TypeError, ValueError, AttributeError, IndexError) as error:
        return {"verdict": "unreadable", "reason": f"unexpected values: {str(error)[:80]!a}"}


def main():
    """Run the program."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("file")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    result = check(arguments.file)
    if arguments.json:
        print(json.dumps(result))
    elif result["verdict"] == "proved":
        last = result["first_module"] + result["part_modules"]
        print(
            f"proved: modules {result['first_module'] + 1} to {last} of {result['modules']} reach "
            f"{result['states']} states by single turns, and none is the goal "
            f"({result['blocked']} of {result['turns']} turns are blocked)"
        )
    else:
        print(f"{result['verdict']}: {result['reason']}")
    sys.exit({"proved": 0, "not proved": 1}.get(result["verdict"], 2))


if __name__ == "__main__":
    main()
