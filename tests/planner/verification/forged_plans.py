"""Forged plans: files that state something false, for checkers to refuse.

``FALSE`` names changes that make any plan false. ``MOTIONS`` changes its motion, size or claimed
clearance; only an exact distance shows whether the result is false, as
``bench.clearance.forgeries`` computes. This file needs only NumPy and ``foldback_check.py``.
"""

import json
from collections.abc import Callable, Mapping
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback import foldback_check

Random = np.random.Generator
Arrays = dict[str, NDArray[Any]]
Meta = dict[str, Any]
Change = Callable[[Random, Arrays, Meta], object]
SIZE: Final = 0.95
FRAME_ARRAYS: Final = (
    *("phase", "max_error_rad", "root_position", "root_wxyz", "base_position", "base_wxyz"),
    *("first", "joint_angles_rad"),
)
"""Arrays of a plan with one row per frame, except the times, which may be any increasing values."""


def save(
    path: FilePath,
    angles: NDArray[np.float64],
    *,
    kind: str = "cube",
    claim: float = 0.01,
    size: float = SIZE,
    geometry: Meta | None = None,
) -> FilePath:
    """Write a plan as docs/certificate.md specifies it, without the planner.

    Args:
        path: Path of the ``.npz`` file.
        angles: (F, J) hinge angles, rad.
        kind: Name of the module.
        claim: Claimed clearance, pitches.
        size: Size of the modules.
        geometry: Geometry of the module; by default that of the name.
    """
    geometry = geometry or foldback_check.MODULES[kind]
    form = foldback_check.FORMATS["pieces" in geometry]
    hinges, rigid = geometry["hinges"], geometry["rigid_links"]
    count = angles.shape[1] // len(hinges) + 1 + rigid
    meta = {
        "chain": {"module": kind, "modules": count, "folded_rad": angles[-1].tolist()},
        "claim": {"format": form, "module": geometry},
        "certificate": {
            "verified": True,
            "verdict": "verified (kinematics only)",
            "module_size": size,
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
    return write(path, arrays, meta)


def write(path: FilePath, arrays: Mapping[str, Any], meta: Meta) -> FilePath:
    """Write a plan's arrays and metadata as its ``.npz`` file."""
    np.savez(path, plan=np.array(json.dumps(meta)), **arrays)
    return path


def rewrite(source: FilePath, path: FilePath, change: Callable[[Arrays, Meta], object]) -> FilePath:
    """Write a plan again after a change."""
    with np.load(source) as file:
        arrays = dict(file)
    meta = json.loads(str(arrays.pop("plan")))
    change(arrays, meta)
    return write(path, arrays, meta)


def forge(source: FilePath, path: FilePath, random: Random, kind: str | None = None) -> str:
    """Write a plan with one change, and return the name of the change.

    Args:
        source: Path of the plan.
        path: Path of the forged plan.
        random: Source of randomness for the change.
        kind: Name of the change; by default a random one, with probability 0.3 one of ``FALSE``.
    """
    name = kind or str(random.choice(list(FALSE if random.random() < 0.3 else MOTIONS)))

    def change(arrays: Arrays, meta: Meta) -> None:
        meta["claim"].pop("angles_sha256", None)  # forgers can compute the digest
        {**FALSE, **MOTIONS}[name](random, arrays, meta)
        if name in MOTIONS:  # only the distance shows it
            meta["certificate"] |= {"frames": len(arrays["time_s"]), "max_joint_step_rad": 9.0}

    rewrite(source, path, change)
    return name


def angles_of(arrays: Arrays) -> NDArray[Any]:
    """Return (F, J) angles, or (V,) angles of windows."""
    return arrays["angles_rad" if "first" in arrays else "joint_angles_rad"]


def select(arrays: Arrays, rows: NDArray[np.integer[Any]]) -> None:
    """Select frames in the given order."""
    if "first" in arrays:
        ends = zip(arrays["offsets"][:-1], arrays["offsets"][1:], strict=True)
        break_windows = [arrays["angles_rad"][a:b] for a, b in ends]
        parts = [break_windows[k] for k in rows]
        arrays["angles_rad"] = np.concatenate(parts)
        arrays["offsets"] = np.cumsum([0, *map(len, parts)])
    for name in set(FRAME_ARRAYS) & arrays.keys():
        arrays[name] = arrays[name][rows]
    arrays["time_s"] = np.sort(arrays["time_s"][rows])


# Other motions ------------------------------------------------------------------------------------


def perturb(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Perturb some hinges during an interval, most at its middle."""
    q = angles_of(arrays)
    if q.ndim == 1:
        changed_frames = random.integers(0, len(q), int(random.integers(1, 40)))
        q[changed_frames] += random.normal(
            0.0, 10.0 ** random.uniform(-4.0, 0.0), len(changed_frames)
        ).astype(q.dtype)
        return
    start = int(random.integers(1, max(2, len(q) - 12)))
    stop = min(len(q) - 1, start + int(random.integers(2, 40)))
    hinges = random.integers(0, q.shape[1], int(random.integers(1, 5)))
    shape = np.sin(np.linspace(0.0, np.pi, stop - start))[:, None]
    q[start:stop, hinges] += shape * random.uniform(-1.5, 1.5, len(hinges))


def offset(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Offset one hinge during the whole motion."""
    q, off = angles_of(arrays), random.choice([-1.0, 1.0]) * 10.0 ** random.uniform(-2.5, 0.0)
    if q.ndim == 1:
        hinge = random.integers(len(arrays["joint_names"]))
        is_spanned = (arrays["first"] <= hinge) & (
            hinge < arrays["first"] + np.diff(arrays["offsets"])
        )
        q[(arrays["offsets"][:-1] + hinge - arrays["first"])[is_spanned]] += off
    else:
        q[1:-1, random.integers(q.shape[1])] += off


def thin_out(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Remove frames: the remaining ones are clear, but modules may meet between them."""
    frames = len(arrays["time_s"])
    changed_frames = random.choice(frames - 2, int(random.integers(1, 12)), replace=False) + 1
    select(arrays, np.concatenate([[0], np.sort(changed_frames), [frames - 1]]))


def swap(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Swap two frames."""
    rows = np.arange(len(arrays["time_s"]))
    first, second = random.choice(len(rows) - 2, 2, replace=False) + 1
    rows[[first, second]] = rows[[second, first]]
    select(arrays, rows)


def reverse(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Reverse the order of consecutive frames."""
    rows = np.arange(len(arrays["time_s"]))
    start, stop = np.sort(random.choice(len(rows) - 2, 2, replace=False) + 1)
    rows[start:stop] = rows[start:stop][::-1]
    select(arrays, rows)


def shift(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Assign angles to other hinges from some frame on."""
    start, by = int(random.integers(1, len(arrays["time_s"]))), int(random.choice([-2, -1, 1, 2]))
    if "first" in arrays:
        arrays["first"][start:] += by
    else:
        arrays["joint_angles_rad"][start:-1] = np.roll(arrays["joint_angles_rad"][start:-1], by, 1)


def overclaim(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Claim more clearance."""
    meta["certificate"]["clearance_bound"] *= float(10.0 ** random.uniform(0.0, 1.5))


def enlarge(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Enlarge the modules."""
    size = meta["certificate"]["module_size"]
    meta["certificate"]["module_size"] = float(random.uniform(size, 1.0))


MOTIONS: Final[dict[str, Change]] = {
    change.__name__: change
    for change in (perturb, offset, thin_out, swap, reverse, shift, overclaim, enlarge)
}
"""Changes after which a plan may still be true, by name."""

# Plans that are false in any case -----------------------------------------------------------------


def shrink_module(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Shrink the module: by a factor, at one corner, or by omitting a corner."""
    module = meta["claim"]["module"]
    corners = np.array(module["corners"])
    smaller = corners * random.uniform(0.5, 0.99)
    dented = np.where(np.arange(corners.size).reshape(corners.shape) == 0, 0.9 * corners, corners)
    module["corners"] = [smaller, dented, corners[1:]][int(random.integers(3))].tolist()


def break_windows(random: Random, arrays: Arrays, meta: Meta) -> None:
    """Move windows beyond the chain, or omit the angles of a hinge."""
    hinges = len(arrays["joint_names"])
    if "first" in arrays:
        arrays["first"] = arrays["first"] + int(random.choice([-hinges, hinges]))
    else:
        arrays["joint_angles_rad"] = arrays["joint_angles_rad"][:, :-1]


def at_some_frame(angle: float) -> Change:
    """Return a change that sets an angle in the middle of the motion."""

    def change(random: Random, arrays: Arrays, meta: Meta) -> None:
        q = angles_of(arrays).reshape(-1)  # a view of the same memory
        q[int(random.integers(len(q) // 3, 2 * len(q) // 3))] = angle

    return change


def _certificate(**values: Callable[[Random], Any]) -> Change:
    """Return a change of the certificate."""
    return lambda random, _, meta: meta["certificate"].update(
        {name: value(random) for name, value in values.items()}
    )


def _exempt(name: str, low: int, high: int) -> Change:
    """Return a change that exempts other pairs."""

    def change(random: Random, arrays: Arrays, meta: Meta) -> None:
        apart, links = meta["claim"]["module"]["apart"], meta["chain"]["modules"] - 1
        pairs = {"apart": apart, "count": (apart - 1) * links}  # missing in older plans
        meta["certificate"].setdefault("exempt_pairs", pairs)[name] = int(
            random.integers(low, high)
        )

    return change


def _module(change: Callable[[Random, Meta], object]) -> Change:
    return lambda random, _, meta: change(random, meta["claim"]["module"])


FALSE: Final[dict[str, Change]] = {
    "exempt pairs": _exempt("apart", 3, 99),
    "count of exempt pairs": _exempt("count", 999, 9999),
    "size above the pitch": _certificate(module_size=lambda random: random.uniform(1.01, 2.0)),
    "no size": _certificate(module_size=lambda random: random.uniform(-1.0, 0.0)),
    "no clearance": _certificate(
        clearance_bound=lambda random: (None, 0.0, -1.0, float("nan"))[int(random.integers(4))]
    ),
    "a huge clearance": _certificate(clearance_bound=lambda random: 10.0 ** random.uniform(1, 9)),
    "verdict": _certificate(verified=lambda random: (False, None, "true", 1)[random.integers(4)]),
    "frames": _certificate(frames=lambda random: int(random.integers(1, 9))),
    "corners": shrink_module,
    "turns": _module(
        lambda random, module: module["turns"][0][0].__setitem__(1, random.uniform(0.1, 1.0))
    ),
    "limit": _module(lambda random, module: module.update(limit_rad=random.uniform(2.0, 3.0))),
    "exempt pairs of the module": _module(
        lambda random, module: module.update(apart=int(random.integers(3, 9)))
    ),
    "kind": lambda random, _, meta: meta["chain"].update(
        module="tetrahedron" if meta["chain"]["module"] == "cube" else "cube"
    ),
    "modules": lambda random, _, meta: meta["chain"].update(
        modules=meta["chain"]["modules"] + int(random.choice([-1, 1]))
    ),
    "folded": lambda random, _, meta: meta["chain"]["folded_rad"].__setitem__(
        int(random.integers(len(meta["chain"]["folded_rad"]))), random.uniform(3.0, 4.0)
    ),
    "names": lambda random, arrays, _: arrays.update(
        joint_names=np.roll(arrays["joint_names"], int(random.integers(1, 7)))
    ),
    "start": lambda random, arrays, meta: meta.update(
        start={"folded_rad": [random.uniform(1.0, 2.0)] * len(arrays["joint_names"])}
    ),
    "times": lambda random, arrays, _: arrays["time_s"].__setitem__(
        int(random.integers(1, len(arrays["time_s"]))), -1.0
    ),
    "no end": lambda random, arrays, _: select(arrays, np.arange(2 * len(arrays["time_s"]) // 3)),
    "digest": lambda random, _, meta: meta["claim"].update(angles_sha256=random.bytes(32).hex()),
    "windows": break_windows,
    "too far": at_some_frame(1.7),
    "no number": at_some_frame(float("nan")),
    "no names": lambda random, arrays, _: arrays.pop("joint_names"),
    "no times": lambda random, arrays, _: arrays.pop("time_s"),
    "angles twice": lambda random, arrays, _: arrays.update(
        angle_planes=np.zeros((4, angles_of(arrays).size), np.uint8)
    ),
}
"""Changes that make any plan false, by name."""
