"""Forged plans: files that state something false, for checkers to refuse.

``FALSE`` names changes that make any plan false, ``MOTIONS`` changes of its motion, size or claimed
clearance that only an exact distance shows to be false: ``bench.clearance.forgeries`` does so.
NumPy and ``foldback_check.py`` are all that this file needs.
"""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import foldback_check

Random = np.random.Generator
Arrays = dict[str, NDArray[Any]]
Told = dict[str, Any]
Change = Callable[[Random, Arrays, Told], object]
SIZE: Final = 0.95
FRAME_ARRAYS: Final = (
    *("phase", "max_error_rad", "root_position", "root_wxyz", "base_position", "base_wxyz"),
    *("first", "joint_angles_rad"),
)
"""Arrays of a plan with one row for each frame, apart from the times, which rise in any order."""


def save(
    path: FilePath,
    angles: NDArray[np.float64],
    *,
    kind: str = "cube",
    claim: float = 0.01,
    geometry: Told | None = None,
) -> FilePath:
    """Write a plan as docs/certificate.md has it, without the planner.

    Args:
        path: Path of the ``.npz`` file.
        angles: (F, J) hinge angles.
        kind: The module's name.
        claim: The clearance that it claims.
        geometry: The module; by default the one of that name.
    """
    geometry = geometry or foldback_check.MODULES[kind]
    hinges, rigid = geometry["hinges"], geometry["rigid_links"]
    count = angles.shape[1] // len(hinges) + 1 + rigid
    told = {
        "chain": {"module": kind, "modules": count, "folded_rad": angles[-1].tolist()},
        "claim": {"module": geometry},
        "certificate": {
            "verdict": "verified (kinematics only)",
            "module_size": SIZE,
            "max_joint_step_rad": 9.0,
            "clearance_bound": claim,
            "exempt_pairs": {
                "apart": geometry["apart"],
                "count": (geometry["apart"] - 1) * (count - 1),
            },
        },
    }
    names = [f"joint_{k}{end}" for k in range(rigid, count - 1) for end in hinges]
    arrays = {
        "joint_names": np.array(names),
        "time_s": np.arange(len(angles), dtype=float),
        "joint_angles_rad": angles,
    }
    return write(path, arrays, told)


def write(path: FilePath, arrays: Mapping[str, Any], told: Told) -> FilePath:
    """Write a plan's arrays, and all else that it says, as its ``.npz`` file."""
    np.savez(path, plan=np.array(json.dumps(told)), **arrays)
    return path


def rewrite(source: FilePath, path: FilePath, change: Callable[[Arrays, Told], object]) -> FilePath:
    """Write a plan again after a change; an older plan also gets the claim that it implies."""
    with np.load(source) as file:
        arrays = dict(file)
    told = json.loads(str(arrays.pop("plan")))
    geometry = foldback_check.MODULES.get(told["chain"]["module"])
    told.setdefault("claim", {"module": copy.deepcopy(geometry)})
    change(arrays, told)
    return write(path, arrays, told)


def forge(source: FilePath, path: FilePath, random: Random, kind: str | None = None) -> str:
    """Write a plan with one change, and return the name of the change.

    Args:
        source: The plan.
        path: Path of the forged one.
        random: Decides how, and what is not given.
        kind: Name of the change; by default any, three of ten times one of ``FALSE``.
    """
    name = kind or str(random.choice(list(FALSE if random.random() < 0.3 else MOTIONS)))

    def change(arrays: Arrays, told: Told) -> None:
        told["claim"].pop("angles_sha256", None)  # whoever forges a plan knows how to work it out
        {**FALSE, **MOTIONS}[name](random, arrays, told)
        if name in MOTIONS:  # nothing but the distance tells
            told["certificate"] |= {"frames": len(arrays["time_s"]), "max_joint_step_rad": 9.0}

    rewrite(source, path, change)
    return name


def angles_of(arrays: Arrays) -> NDArray[Any]:
    """Return (F, J) angles, of windows (V,)."""
    return arrays["angles_rad" if "first" in arrays else "joint_angles_rad"]


def take(arrays: Arrays, rows: NDArray[np.integer[Any]]) -> None:
    """Keep these frames, in this order."""
    if "first" in arrays:
        ends = zip(arrays["offsets"][:-1], arrays["offsets"][1:], strict=True)
        windows = [arrays["angles_rad"][a:b] for a, b in ends]
        parts = [windows[k] for k in rows]
        arrays["angles_rad"] = np.concatenate(parts)
        arrays["offsets"] = np.cumsum([0, *map(len, parts)])
    for name in set(FRAME_ARRAYS) & arrays.keys():
        arrays[name] = arrays[name][rows]
    arrays["time_s"] = np.sort(arrays["time_s"][rows])


# ------------------------------------------------------------------ another motion


def bent(random: Random, arrays: Arrays, told: Told) -> None:
    """Some hinges are off for a while, most at its middle."""
    q = angles_of(arrays)
    if q.ndim == 1:
        where = random.integers(0, len(q), int(random.integers(1, 40)))
        q[where] += random.normal(0.0, 10.0 ** random.uniform(-4.0, 0.0), len(where)).astype(
            q.dtype
        )
        return
    start = int(random.integers(1, max(2, len(q) - 12)))
    stop = min(len(q) - 1, start + int(random.integers(2, 40)))
    hinges = random.integers(0, q.shape[1], int(random.integers(1, 5)))
    shape = np.sin(np.linspace(0.0, np.pi, stop - start))[:, None]
    q[start:stop, hinges] += shape * random.uniform(-1.5, 1.5, len(hinges))


def one_hinge(random: Random, arrays: Arrays, told: Told) -> None:
    """One hinge is off all the way."""
    q, off = angles_of(arrays), random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(-2.5, 0.0)
    if q.ndim == 1:
        hinge = random.integers(len(arrays["joint_names"]))
        held = (arrays["first"] <= hinge) & (hinge < arrays["first"] + np.diff(arrays["offsets"]))
        q[(arrays["offsets"][:-1] + hinge - arrays["first"])[held]] += off
    else:
        q[1:-1, random.integers(q.shape[1])] += off


def fewer(random: Random, arrays: Arrays, told: Told) -> None:
    """Frames are left out: those that are kept are clear, and modules meet between them."""
    frames = len(arrays["time_s"])
    kept = random.choice(frames - 2, int(random.integers(1, 12)), replace=False) + 1
    take(arrays, np.concatenate([[0], np.sort(kept), [frames - 1]]))


def swapped(random: Random, arrays: Arrays, told: Told) -> None:
    """Two frames change places."""
    rows = np.arange(len(arrays["time_s"]))
    one, other = random.choice(len(rows) - 2, 2, replace=False) + 1
    rows[[one, other]] = rows[[other, one]]
    take(arrays, rows)


def backwards(random: Random, arrays: Arrays, told: Told) -> None:
    """Some frames in a row come in the opposite order."""
    rows = np.arange(len(arrays["time_s"]))
    start, stop = np.sort(random.choice(len(rows) - 2, 2, replace=False) + 1)
    rows[start:stop] = rows[start:stop][::-1]
    take(arrays, rows)


def shifted(random: Random, arrays: Arrays, told: Told) -> None:
    """From some frame on, angles belong to other hinges."""
    start, by = int(random.integers(1, len(arrays["time_s"]))), int(random.choice([-2, -1, 1, 2]))
    if "first" in arrays:
        arrays["first"][start:] += by
    else:
        arrays["joint_angles_rad"][start:-1] = np.roll(arrays["joint_angles_rad"][start:-1], by, 1)


def claimed(random: Random, arrays: Arrays, told: Told) -> None:
    """More clearance is claimed."""
    told["certificate"]["clearance_bound"] *= float(10.0 ** random.uniform(0.0, 1.5))


def grown(random: Random, arrays: Arrays, told: Told) -> None:
    """Modules are larger."""
    size = told["certificate"]["module_size"]
    told["certificate"]["module_size"] = float(random.uniform(size, 1.0))


MOTIONS: Final[dict[str, Change]] = {
    change.__name__: change
    for change in (bent, one_hinge, fewer, swapped, backwards, shifted, claimed, grown)
}
"""Changes after which a plan may be true, by name."""

# ------------------------------------------------------------------ what is false in any case


def corners(random: Random, arrays: Arrays, told: Told) -> None:
    """The module is smaller than what it is called: by a share, at a corner, or without one."""
    module = told["claim"]["module"]
    held = np.array(module["corners"])
    smaller = held * random.uniform(0.5, 0.99)
    dented = np.where(np.arange(held.size).reshape(held.shape) == 0, 0.9 * held, held)
    module["corners"] = [smaller, dented, held[1:]][int(random.integers(3))].tolist()


def windows(random: Random, arrays: Arrays, told: Told) -> None:
    """Windows lie beyond the chain, or a hinge has no angles."""
    hinges = len(arrays["joint_names"])
    if "first" in arrays:
        arrays["first"] = arrays["first"] + int(random.choice([-hinges, hinges]))
    else:
        arrays["joint_angles_rad"] = arrays["joint_angles_rad"][:, :-1]


def at_some_frame(angle: float) -> Change:
    """Return a change that sets an angle in the middle of the motion."""

    def change(random: Random, arrays: Arrays, told: Told) -> None:
        q = angles_of(arrays).reshape(-1)  # shares its memory
        q[int(random.integers(len(q) // 3, 2 * len(q) // 3))] = angle

    return change


def _certificate(**values: Callable[[Random], Any]) -> Change:
    """Return a change of what the certificate says."""
    return lambda random, _, told: told["certificate"].update(
        {name: value(random) for name, value in values.items()}
    )


def _exempt(name: str, low: int, high: int) -> Change:
    """Return a change that exempts other pairs."""

    def change(random: Random, arrays: Arrays, told: Told) -> None:
        apart, links = told["claim"]["module"]["apart"], told["chain"]["modules"] - 1
        pairs = {"apart": apart, "count": (apart - 1) * links}  # not in older plans
        told["certificate"].setdefault("exempt_pairs", pairs)[name] = int(
            random.integers(low, high)
        )

    return change


def _module(change: Callable[[Random, Told], object]) -> Change:
    return lambda random, _, told: change(random, told["claim"]["module"])


FALSE: Final[dict[str, Change]] = {
    "exempt pairs": _exempt("apart", 3, 99),
    "count of exempt pairs": _exempt("count", 999, 9999),
    "size above the pitch": _certificate(module_size=lambda random: random.uniform(1.01, 2.0)),
    "no size": _certificate(module_size=lambda random: random.uniform(-1.0, 0.0)),
    "no clearance": _certificate(
        clearance_bound=lambda random: (None, 0.0, -1.0, float("nan"))[int(random.integers(4))]
    ),
    "a huge clearance": _certificate(clearance_bound=lambda random: 10.0 ** random.uniform(1, 9)),
    "verdict": _certificate(
        verdict=lambda random: str(random.choice(["failed: overlap", "not verified"]))
    ),
    "frames": _certificate(frames=lambda random: int(random.integers(1, 9))),
    "corners": corners,
    "turns": _module(
        lambda random, module: module["turns"][0][0].__setitem__(1, random.uniform(0.1, 1.0))
    ),
    "limit": _module(lambda random, module: module.update(limit_rad=random.uniform(2.0, 3.0))),
    "exempt pairs of the module": _module(
        lambda random, module: module.update(apart=int(random.integers(3, 9)))
    ),
    "kind": lambda random, _, told: told["chain"].update(
        module="tetrahedron" if told["chain"]["module"] == "cube" else "cube"
    ),
    "modules": lambda random, _, told: told["chain"].update(
        modules=told["chain"]["modules"] + int(random.choice([-1, 1]))
    ),
    "folded": lambda random, _, told: told["chain"]["folded_rad"].__setitem__(
        int(random.integers(len(told["chain"]["folded_rad"]))), random.uniform(3.0, 4.0)
    ),
    "names": lambda random, arrays, _: arrays.update(
        joint_names=np.roll(arrays["joint_names"], int(random.integers(1, 7)))
    ),
    "start": lambda random, arrays, told: told.update(
        start={"folded_rad": [random.uniform(1.0, 2.0)] * len(arrays["joint_names"])}
    ),
    "times": lambda random, arrays, _: arrays["time_s"].__setitem__(
        int(random.integers(1, len(arrays["time_s"]))), -1.0
    ),
    "no end": lambda random, arrays, _: take(arrays, np.arange(2 * len(arrays["time_s"]) // 3)),
    "digest": lambda random, _, told: told["claim"].update(angles_sha256=random.bytes(32).hex()),
    "windows": windows,
    "too far": at_some_frame(1.7),
    "no number": at_some_frame(float("nan")),
    "no names": lambda random, arrays, _: arrays.pop("joint_names"),
    "no times": lambda random, arrays, _: arrays.pop("time_s"),
    "angles twice": lambda random, arrays, _: arrays.update(
        angle_planes=np.zeros((4, angles_of(arrays).size), np.uint8)
    ),
}
"""Changes that make any plan false, by name."""
