"""Modules of several pieces and parts: both independent checkers prove them, and no forged one."""

import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
import pytest

from bench.clearance.forgeries import distance
from foldback import foldback_check
from foldback.planner.chain.built_in_modules import MODULE_NAMES, module_named
from foldback.planner.chain.module import Module
from foldback.planner.chain.module_file import read_module, with_pattern
from foldback.planner.chain.rotations import axis_rotation
from foldback.planner.plan.claim import geometry_of
from tests.planner.chains import Array
from tests.planner.verification.forged_plans import Meta, rewrite, save
from tests.web.node import JavaScriptChecker

HALF: Final = [
    *([x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5) if x + y + z > 0),
    *([0.5, -0.5, 0.0], [-0.5, 0.5, 0.0], [0.0, 0.5, -0.5], [0.0, -0.5, 0.5]),
    *([0.5, 0.0, -0.5], [-0.5, 0.0, 0.5]),
]
"""Corners of the half of a cube with x + y + z ≥ 0."""
HALVES: Final = read_module(
    {
        "format": "foldback-module/1",
        "name": "halves",
        "words": {"singular": "pair of halves", "plural": "pairs of halves"},
        "pieces": [
            {
                "name": "halves",
                "parts": [
                    {"corners": HALF},
                    {"corners": [[1.0 - x, -y, -z] for x, y, z in HALF]},
                ],
                "entry": {"at": [0, 0, 0]},
                "exit": {"at": [1, 0, 0]},
                "joint": {
                    "kind": "hinge",
                    "hinges": [{"axis": [1, 1, 1], "range_deg": [-130, 250]}],
                    "step_deg": 120,
                },
            }
        ],
        "pattern": ["halves"],
    }
)
"""Halves of two neighbouring cubes that are cut at right angles to a diagonal and turn about it."""
ORDER: Final = ["straight", "corner", "corner", "straight", "corner", "corner", "straight"]
MODULES: Final[dict[str, Module]] = {
    "prisms": module_named("snake-prism"),
    "cubes": with_pattern(module_named("snake-cube"), ORDER),
    "bent cubes": with_pattern(module_named("snake-cube"), ORDER, [0, 20, 90, 0, -35, 180, 0]),
    "halves": HALVES,
}
SIZES: Final = {"prisms": 0.95, "cubes": 0.95, "bent cubes": 0.8, "halves": 0.8}
FOLDED: Final = {
    "prisms": np.deg2rad([45.0, 0, 180, 0, 0, -45]),
    "cubes": np.deg2rad([-90.0, 0, 180, 45, 0, 90]),
    "bent cubes": np.deg2rad([-90.0, 90, 180, 90, -45, -90]),
    "halves": np.deg2rad([0.0, -120, 120, -120, 0, 120]),
}
"""Angles of chains of seven modules whose hinges can turn there all at once."""


@pytest.fixture(scope="module")
def by_script() -> Iterator[JavaScriptChecker]:
    with JavaScriptChecker() as checker:
        yield checker


def motion(kind: str) -> Array:
    return np.linspace(0.0, 1.0, 9)[:, None] * FOLDED[kind]


def written(path: FilePath, kind: str, claim: float) -> FilePath:
    module = MODULES[kind]
    geometry, size = geometry_of(module), SIZES[kind]
    return save(path, motion(kind), kind=module.name, claim=claim, size=size, geometry=geometry)


def bodies(module: Module, size: float, angles: Array) -> list[list[Array]]:
    """Return the corners of the parts of all modules, from the planner's links."""
    rotation, place, shapes = np.eye(3), np.zeros(3), []
    for k, angle in enumerate([*angles, 0.0]):
        shapes.append([place + size * part.corners @ rotation.T for part in module.piece(k).parts])
        link = module.link(k)
        place = place + rotation @ link.anchor
        rotation = rotation @ axis_rotation(link.axes[0], angle) @ link.turn
        place = place + rotation @ link.offset
    return shapes


def min_distance(module: Module, size: float, q: Array) -> float:
    """Return the exact distance of the nearest parts of two modules at some moments."""
    return min(
        distance(one, other)
        for angles in q
        for shapes in [bodies(module, size, angles)]
        for i in range(len(shapes))
        for j in range(i + 1, len(shapes))
        for one in shapes[i]
        for other in shapes[j]
        if np.linalg.norm(one.mean(0) - other.mean(0)) < 1.5
    )


@pytest.mark.parametrize("kind", MODULES)
def test_both_checkers_prove_a_motion_but_not_more_than_its_clearance(
    kind: str, by_script: JavaScriptChecker, tmp_path: FilePath
) -> None:
    limit = f", but {foldback_check.OTHER_MODULE}" if kind == "halves" else ""
    clearance = min_distance(MODULES[kind], SIZES[kind], motion(kind))
    for claim, expected in ((0.03, f"proved{limit}"), (clearance + 1e-6, "not proved")):
        path = written(tmp_path / "plan.npz", kind, claim)
        result, other = foldback_check.check(path), by_script(path)
        assert result["verdict"] == other["verdict"] == expected, (result, other)
        if claim < clearance:
            assert result["looks"] == pytest.approx(other["pairs"], rel=0.05)
            for key in ("start", "end", "module", "exempt"):
                assert result[key] == other[key]
            assert result["start"] == "at rest (all hinges at 0)"


def in_windows(arrays: dict[str, Any], meta: Meta) -> None:
    """Turn the hinges one after the other, in windows of two."""
    folded = arrays.pop("joint_angles_rad")[-1].astype("f4")
    meta["chain"]["folded_rad"] = folded.tolist()
    values, first = [np.zeros(2)], [0]
    for hinge in range(len(folded) - 1):
        values += [(share * folded[hinge], 0.0) for share in (0.25, 0.5, 0.75, 1.0)]
        first += [hinge] * 4
    values += [(folded[-2], share * folded[-1]) for share in (0.25, 0.5, 0.75, 1.0)]
    first += [len(folded) - 2] * 4
    arrays |= {
        "time_s": np.arange(len(first), dtype=float),
        "first": np.array(first),
        "offsets": 2 * np.arange(len(first) + 1),
        "angles_rad": np.ravel(values).astype("f4"),
    }


@pytest.mark.parametrize("kind", MODULES)
def test_modules_behind_a_window_follow_their_pattern(
    kind: str, by_script: JavaScriptChecker, tmp_path: FilePath
) -> None:
    path = rewrite(written(tmp_path / "plan.npz", kind, 1e-3), tmp_path / "windows.npz", in_windows)
    plan = foldback_check.Plan(path)
    proof = foldback_check.Proof.__new__(foldback_check.Proof)
    proof._halves = lambda items: []  # type: ignore[method-assign]
    proof.__init__(plan)  # type: ignore[misc]
    for frame in (0, 6, 10):
        batch = foldback_check.Batch(proof, [(frame, 0.0, 1.0, None)])
        rates = [plan.angles(k, 0, len(plan.folded)) for k in (frame, frame + 1)]
        middle = plan.module.chain(rates[0] + foldback_check.NODES[2] * (rates[1] - rates[0]))
        modules, first = np.arange(plan.count), np.zeros(plan.count, int)
        poses = foldback_check.relative(batch.poses(first, first), batch.poses(modules, first))[
            :, 2
        ]
        expected = foldback_check.relative(middle[0], middle)
        np.testing.assert_allclose(poses, expected, atol=1e-12)
        low, high = batch.boxes()
        root = foldback_check.relative(middle[batch.c], middle)[:, 0]
        assert ((low[:, 0] <= root) & (root <= high[:, 0])).all()
    result, other = foldback_check.check(path), by_script(path)
    assert result["verdict"] == other["verdict"]
    assert result["looks"] == other["pairs"]
    assert result["tightest"]["gap"] == pytest.approx(other["tightest"]["gap"], abs=1e-9)


def away(corners: list[list[float]]) -> list[float]:
    """Return a corner of the cut between two halves, farther from the middle of its part."""
    middle = np.mean(corners, axis=0)
    return (middle + 3.0 * (corners[4] - middle)).tolist()


def replaced(**values: Any) -> Callable[[Meta], object]:
    return lambda module: module.update(values)


FORGED: Final[dict[str, tuple[str, Callable[[Meta], object], str]]] = {
    "a part left out": ("cubes", lambda m: m["pieces"][1].clear(), "expected a list of 16 parts"),
    "a part more": (
        "prisms",
        lambda m: m["pieces"][0].append(m["pieces"][0][0]),
        "but of another kind",
    ),
    "another piece": (
        "cubes",
        lambda m: m["pieces"].__setitem__(0, geometry_of(MODULES["prisms"])["pieces"][0]),
        "but of another kind",
    ),
    "a smaller piece": (
        "prisms",
        lambda m: m["pieces"][0][0].update(
            corners=(0.9 * np.array(m["pieces"][0][0]["corners"])).tolist()
        ),
        "but of another kind",
    ),
    "a corner outside the faces": (
        "halves",
        lambda m: m["pieces"][0][0]["corners"].__setitem__(4, away(m["pieces"][0][0]["corners"])),
        "a part with corners outside its faces",
    ),
    "another axis": (
        "prisms",
        lambda m: m["links"][0]["turns"].reverse(),
        "but of another kind",
    ),
    "another turn": (
        "halves",
        lambda m: m["links"][0]["turns"].__setitem__(
            1, (np.diag([-1, 1, -1]) @ m["links"][0]["turns"][1]).tolist()
        ),
        "modules",
    ),
    "a mirrored turn": (
        "halves",
        lambda m: m["links"][0]["turns"][0].reverse(),
        "a module that cannot be",
    ),
    "another anchor": (
        "cubes",
        lambda m: m["links"][1]["anchor"].__setitem__(0, 0.4),
        "but of another kind",
    ),
    "a range of a hinge that has none": (
        "cubes",
        lambda m: m["links"][0].update(ranges_rad=[[-1.0, 1.0]]),
        "but of another kind",
    ),
    "a range too narrow for the motion": (
        "halves",
        lambda m: m["links"][0].update(ranges_rad=[[-2.0, 3.0]]),
        "range",
    ),
    "a range without 0": (
        "halves",
        lambda m: m["links"][0].update(ranges_rad=[[-4.0, -0.1]]),
        "a module that cannot be",
    ),
    "a range of many turns": (
        "halves",
        lambda m: m["links"][0].update(ranges_rad=[[-9.0, 9.0]]),
        "a module that cannot be",
    ),
    "ranges for two hinges": (
        "halves",
        lambda m: m["links"][0].update(ranges_rad=[None, None]),
        "expected a list of 1 parts",
    ),
    "a shifted pattern": (
        "cubes",
        lambda m: m["pattern"].append(m["pattern"].pop(0)),
        "modules",
    ),
    "a piece beyond the list": ("cubes", replaced(pattern=[[2, 0]]), "whole number from 0 to 1"),
    "a link beyond the list": ("cubes", replaced(pattern=[[0, 9]]), "whole number from 0 to 3"),
    "half a piece": ("cubes", replaced(pattern=[[0.5, 0]]), "whole number from 0 to 1"),
    "no pattern": ("cubes", replaced(pattern=[]), "expected a list of 262144 parts at most"),
    "no links": ("cubes", replaced(links=[]), "expected a list of 262144 parts at most"),
    "exempt neighbours": ("prisms", replaced(apart=2), "but of another kind"),
    "many parts": (
        "halves",
        lambda m: m["pieces"][0].extend(m["pieces"][0] * 8),
        "expected a list of 16 parts at most",
    ),
}
"""Changes of a plan's module by name: the plan, the change, and words of both checkers."""


@pytest.mark.parametrize("name", FORGED)
def test_forged_modules_are_refused_with_a_sentence(
    name: str, by_script: JavaScriptChecker, tmp_path: FilePath
) -> None:
    kind, change, words = FORGED[name]
    path = written(tmp_path / "plan.npz", kind, 0.03)
    rewrite(path, path, lambda _, meta: change(meta["claim"]["module"]))
    try:
        result = foldback_check.check(path)
    except ValueError as error:
        result = {"verdict": "no plan", "reason": str(error)}
    other = by_script(path)
    assert result["verdict"] == other["verdict"], (result, other)
    assert result["verdict"] in ("not proved", "no plan")
    assert words in result["reason"]
    assert words in other["text"]


def test_shipped_twist_modules_are_known_in_any_pattern_and_shape_at_rest() -> None:
    for name in foldback_check.TWISTS:
        module = module_named(name)
        pieces = [piece.name for piece in module.pieces]
        for pattern in (pieces, pieces[::-1] * 2, pieces[-1:]):
            for rest in (None, [15.0 * k for k in range(len(pattern))]):
                values = geometry_of(with_pattern(module, pattern, rest))
                described = foldback_check.geometry(values, foldback_check.FORMATS[1])
                assert foldback_check.is_usual(name, described)
    assert {*foldback_check.TWISTS, *foldback_check.MODULES} <= set(MODULE_NAMES)


def test_many_corners_and_edges_take_little_memory(tmp_path: FilePath) -> None:
    geometry = geometry_of(MODULES["prisms"])
    part = geometry["pieces"][0][0]
    part |= {"corners": part["corners"] * 16, "edges": part["edges"] * 24}
    angles = np.zeros((2, 39)) + [[0.0], [1e-3]]
    path = save(tmp_path / "plan.npz", angles, kind="many", claim=0.04, geometry=geometry)
    tracemalloc.start()
    result = foldback_check.check(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert "no gap above 0.033333333" in result["reason"]
    assert peak < 2**28
