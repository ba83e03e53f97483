"""Independent checker: it proves correct plans, and no false plan."""

import ast
import json
import os
import subprocess
import sys
import tracemalloc
from contextlib import suppress
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
import pytest

from bench.clearance.forgeries import distance
from foldback import foldback_check, foldback_check_refusals
from foldback.planner.chain.built_in_modules import CUBE, TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.packed_fold import unpack
from foldback.planner.plan.claim import geometry_of
from foldback.planner.plan.plan import Plan
from tests.case import case
from tests.planner.chains import Array, unvalidated
from tests.planner.conftest import SHAPES, Folded
from tests.planner.peels import peel, snake, windows_of
from tests.planner.plans import unverified
from tests.planner.verification import strange_plans
from tests.planner.verification.forged_plans import FALSE, SIZE, forge, rewrite, save

FINISHED: Final = FilePath(__file__).parents[3] / "server" / "shipped_folds"
PRISM: Final = {
    # A hexagonal prism along x, whose joint is at the centre of its face and turns about y.
    "corners": [
        [x, 0.45 * np.cos(a), 0.45 * np.sin(a)]
        for x in (-0.4, 0.4)
        for a in np.arange(6) * np.pi / 3
    ],
    "faces": [[1.0, 0.0, 0.0]],
    "edges": [[1.0, 0.0, 0.0]],
    "anchor": [0.5, 0.0, 0.0],
    "offset": [0.5, 0.0, 0.0],
    "turns": [
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
        [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
    ],
    "hinges": [""],
    "rigid_links": 0,
    "apart": 2,
    "limit_rad": 1.6,
}


def verdict(path: FilePath, **options: Any) -> str:
    return str(foldback_check.check(path, **options)["verdict"])


def imported(program: Any) -> set[str | None]:
    nodes = list(ast.walk(ast.parse(FilePath(program.__file__).read_text(encoding="utf-8"))))
    import_nodes = [node for node in nodes if isinstance(node, ast.Import)]
    parts = {node.module for node in nodes if isinstance(node, ast.ImportFrom)}
    return (
        parts
        | {name.name for node in import_nodes for name in node.names} - sys.stdlib_module_names
    )


def test_checker_needs_numpy_alone_and_shares_geometry() -> None:
    assert imported(foldback_check) == {"numpy"}
    assert imported(foldback_check_refusals) == {
        "numpy",
        "foldback_check",
        "foldback.foldback_check",
    }
    assert geometry_of(CUBE) == foldback_check.CUBE
    assert geometry_of(TETRAHEDRON) == foldback_check.TETRAHEDRON


@pytest.mark.parametrize("name", ["tetra-cube-2", "wrench-80-to-mallet-80"])
def test_shipped_folds_are_proved(name: str, tmp_path: FilePath) -> None:
    unpack((FINISHED / f"{name}.fold").read_bytes(), tmp_path)
    check_result = foldback_check.check(tmp_path / "plan.npz")
    assert check_result["verdict"] == "proved", check_result
    assert check_result["rounding"] < 1e-7
    grown = foldback_check.check(tmp_path / "plan.npz", size=1.0)
    assert grown["verdict"] == "not proved", "modules of full size touch when they are folded"


def test_end_is_compared_with_a_path_or_the_angles_of_a_chain(
    folded: Folded, tmp_path: FilePath
) -> None:
    plan = folded.directory / "plan.npz"
    assert verdict(plan, end=SHAPES / "wrench-24.json") == "proved"
    assert verdict(plan, end=SHAPES / "mallet-24.json") == "not proved"
    unpack((FINISHED / "tetra-cube-2.fold").read_bytes(), tmp_path)
    chain = foldback_check.Plan(tmp_path / "plan.npz")
    shape = SHAPES / "tetra-cube-2.json"
    foldback_check.check_shape(chain, chain.frames - 1, shape)
    angles, other_path = json.loads(shape.read_text())["joint_angles_deg"], tmp_path / "other.json"
    for wrong in ([*angles[:-1], angles[-1] + 1e-3], angles[:-1], []):
        other_path.write_text(json.dumps({"joint_angles_deg": wrong}), encoding="utf-8")
        with pytest.raises(foldback_check.NotProved, match="the chain is not as"):
            foldback_check.check_shape(chain, chain.frames - 1, other_path)


def test_new_plan_states_its_checksum(folded: Folded, tmp_path: FilePath) -> None:
    def other(arrays: dict[str, Any], meta: Any) -> None:
        arrays["joint_angles_rad"][5, 5] += 1e-9

    plan = folded.directory / "plan.npz"
    check_result = foldback_check.check(rewrite(plan, tmp_path / "plan.npz", other))
    assert "checksum" in str(check_result["reason"])


def random_motion(random: np.random.Generator, kind: Any, modules: int) -> Array:
    """Return angles from straight on, in a few large steps; the chain may pass through itself."""
    hinges = (modules - 1 - kind.rigid_links) * kind.hinges_per_joint
    limit = kind.largest_angle_rad
    scale = random.choice([0.2, 0.6, 1.0])
    steps = random.uniform(-scale, scale, (4, hinges)) * (random.random((4, hinges)) < 0.6)
    return np.clip(np.vstack([np.zeros(hinges), steps.cumsum(axis=0)]), -limit, limit)


def interpolate(q: Array, count: int) -> Array:
    at = np.linspace(0, len(q) - 1, (len(q) - 1) * count + 1)
    return np.stack([np.interp(at, range(len(q)), column) for column in q.T], axis=1)


def min_distance(chain: Chain, q: Array) -> float:
    """Return the exact distance of the closest modules that are not exempt, over sampled frames."""
    corners, least_separation = chain.module.pieces[0].corners * SIZE, 9.0
    for angles in q:
        poses = chain.poses(angles, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        hulls = poses.positions[:, None] + corners @ poses.rotations.swapaxes(1, 2)
        for i in range(len(hulls)):
            for j in range(i + chain.module.apart, len(hulls)):
                if np.linalg.norm(poses.positions[i] - poses.positions[j]) < 2.0:
                    least_separation = min(least_separation, distance(hulls[i], hulls[j]))
    return least_separation


@pytest.mark.parametrize("kind", [CUBE, TETRAHEDRON], ids=lambda kind: kind.name)
def test_random_motions_are_proved_only_up_to_their_clearance(
    kind: Any, tmp_path: FilePath
) -> None:
    random, proved, refused = np.random.default_rng(7), 0, 0
    for _ in range(20):
        q = random_motion(random, kind, int(random.integers(4, 14)))
        chain, fine = unvalidated(kind, q[-1]), interpolate(q, 40)
        least_clearance = min(
            sweep(chain, sampled_angles, module_size=SIZE, share=0.0).clearance
            for sampled_angles in (q, fine)
        )
        for claim in (
            0.5 * least_clearance,
            0.98 * least_clearance,
            least_clearance + 1e-6,
            least_clearance + 0.02,
            0.01,
        ):
            if claim <= 1e-6 or least_clearance > 0.19:
                continue
            is_proved = (
                verdict(save(tmp_path / "plan.npz", q, kind=kind.name, claim=claim)) == "proved"
            )
            proved, refused = proved + is_proved, refused + (not is_proved)
            if is_proved and claim > least_clearance:  # axes give a lower bound
                assert claim <= min_distance(chain, fine[::8]) + 1e-7
            assert is_proved or claim > 0.97 * least_clearance, (claim, least_clearance)
    assert min(proved, refused) > 6


@pytest.mark.parametrize("width", [6, 18])
def test_windows_are_proved_as_all_their_frames(width: int, tmp_path: FilePath) -> None:
    chain = snake((3, 3, 3))
    motion = peel(chain, width=width, step=1.5)
    ends = list(zip(motion.offsets[:-1], motion.offsets[1:], strict=True))
    angles = [motion.angles_rad[a:b].astype(float) for a, b in reversed(ends)]
    backwards = windows_of(chain, motion.first[::-1].tolist(), angles)
    plan = unverified(chain, backwards, Parameters())
    path, whole_path = tmp_path / "plan.npz", tmp_path / "whole.npz"
    plan.save_npz(path)
    dense = backwards.dense(chain).joint_angles_rad
    size = 0.5
    claim = 0.95 * sweep(chain, dense, module_size=size).clearance

    def verified(arrays: dict[str, Any], meta: Any) -> None:
        meta["certificate"] |= {"verified": True, "reason": None, "clearance_bound": claim}

    rewrite(path, path, verified)
    save(whole_path, dense, claim=claim)
    assert claim > 0.0
    assert verdict(path, size=size) == verdict(whole_path, size=size) == "proved"
    assert verdict(path, size=size, claim=1.06 * claim) == "not proved"
    assert Plan.load(path).motion.is_windowed


def test_any_convex_module_of_the_plan(tmp_path: FilePath) -> None:
    path = tmp_path / "plan.npz"
    for turns, expected_verdict in (((0.5, 0.9), strange_plans.MODULE), ((1.5,), "not proved")):
        q = np.outer([0.0, *turns], np.ones(5))
        assert verdict(save(path, q, kind="prism", geometry=PRISM, claim=0.01)) == expected_verdict


@pytest.mark.parametrize("kind", FALSE)
def test_forged_plan_is_not_proved(kind: str, folded: Folded, tmp_path: FilePath) -> None:
    plan = folded.directory / "plan.npz"
    forge(plan, path := tmp_path / "plan.npz", np.random.default_rng(5), kind)
    with suppress(ValueError):
        assert verdict(path) == "not proved"


@pytest.mark.parametrize(
    ("name", "status"),
    [
        ("a refold", 0),
        ("small modules", 0),
        ("a hostile verdict", 1),
        ("a hostile claim", 1),
        ("deep lists", 2),
        ("a hostile name", 3),
        ("the last frames", 4),
        ("one frame, folded", 5),
        ("own module and start", 3),
    ],
)
def test_exit_status_and_words_state_the_limits_of_a_proof(
    name: str, status: int, tmp_path: FilePath, capsys: pytest.CaptureFixture[str]
) -> None:
    ways = {name: way for name, (way, _) in strange_plans.STRANGE.items()} | strange_plans.TRUE
    path = str(strange_plans.write(ways[name], tmp_path / "plan.npz"))
    assert foldback_check.main([path]) == status
    printed = "".join(capsys.readouterr())
    assert printed.replace("\n", "").isprintable()
    assert printed.isascii()
    assert len(printed) < 900
    assert foldback_check.main([path, "--json"]) == status
    answer = json.loads(capsys.readouterr().out)
    assert printed.startswith("proved:") == (answer["verdict"] == "proved") == (status == 0)
    if status in (0, 3, 4, 5):
        assert f"of size {answer['size']:g} ({answer['module']})" in printed
        assert f"begins {answer['start']}.\nIt ends {answer['end']}." in printed
    else:
        assert answer["verdict"] == {1: "not proved", 2: "no plan"}[status]
        assert answer["reason"] in printed


def test_start_is_compared_with_a_file(tmp_path: FilePath) -> None:
    plan = strange_plans.write(strange_plans.TRUE["a refold"], tmp_path / "plan.npz")
    start, other_path = tmp_path / "start.json", tmp_path / "other.json"
    start.write_text(json.dumps({"joint_angles_deg": np.degrees(strange_plans.OTHER).tolist()}))
    other_path.write_text(
        json.dumps({"joint_angles_deg": np.degrees(strange_plans.FOLDED).tolist()})
    )
    assert verdict(plan, start=start, end=other_path) == "proved"
    assert "in frame 1," in str(foldback_check.check(plan, start=other_path)["reason"])
    straight = tmp_path / "straight.json"
    straight.write_text(json.dumps({"cells": [[k, 0, 0] for k in range(8)]}))
    true = strange_plans.write(strange_plans.TRUE["windows"], tmp_path / "true.npz")
    assert verdict(true, start=straight) == "proved"
    assert verdict(plan, start=straight) == "not proved"


@pytest.mark.parametrize(
    "name", ["an array nobody asked for", "more zeros than stated", "as many zeros as stated"]
)
def test_array_that_is_not_needed_takes_no_memory(name: str, tmp_path: FilePath) -> None:
    ways = {name: way for name, (way, _) in strange_plans.STRANGE.items()} | strange_plans.TRUE
    path = strange_plans.write(ways[name], tmp_path / "plan.npz")
    tracemalloc.start()
    with suppress(ValueError):
        foldback_check.check(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 2**22


def test_module_that_is_no_solid_proves_nothing(tmp_path: FilePath) -> None:
    q = np.outer([0.0, 0.5, 0.9], np.ones(5))
    for name, value in {
        "corners": [[float("nan")] * 3] * 8,
        "anchor": [float("inf"), 0.0, 0.0],
        "offset": [float("nan")] * 3,
        "faces": [[2.0, 0.0, 0.0]],
        "edges": [[float("nan")] * 3],
        "apart": 5,
        "rigid_links": -1,
    }.items():
        path = save(tmp_path / "plan.npz", q, kind="prism", geometry=PRISM)
        rewrite(path, path, lambda _, meta, new={name: value}: meta["claim"]["module"].update(new))
        with case(name), suppress(ValueError):
            assert verdict(path) == "not proved"


def test_files_that_are_no_plans_exit_with_two(tmp_path: FilePath, capsys: Any) -> None:
    path = tmp_path / "plan.npz"
    for content in (b"", b"PK\x03\x04", b"{}"):
        path.write_bytes(content)
        assert foldback_check.main([str(path)]) == 2
    np.savez(path, plan=np.array("[1, 2]"))
    assert foldback_check.main([str(path)]) == 2
    assert "no plan" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["--json"]], ids=["words", "json"])
def test_output_that_cannot_be_written_gives_no_traceback(
    arguments: list[str], tmp_path: FilePath
) -> None:
    plan = strange_plans.write(strange_plans.TRUE["windows"], tmp_path / "plan.npz")
    command = [sys.executable, foldback_check.__file__, str(plan), *arguments]
    read, write = os.pipe()
    os.close(read)
    with os.fdopen(write, "wb") as closed, open("/dev/full", "wb") as full:
        piped, filled = (
            subprocess.run(command, stdout=out, stderr=subprocess.PIPE, text=True, check=False)
            for out in (closed, full)
        )
    assert (piped.returncode, piped.stderr) == (0, "")
    assert filled.returncode == 2
    assert filled.stderr == "the answer cannot be written: No space left on device\n"
