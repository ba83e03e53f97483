"""Scripts of pages under node: they compute the same values as Python.

The tests themselves are in ``js/``, one file for a script or two. Python's values are passed to
them in a JSON file; arrays in it are messages of ``web.timeline.columns``, as pages get them.
"""

import base64
import json
import os
import re
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from foldback.planner.chain.built_in_modules import TETRAHEDRON, module_named
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_from_attributes
from foldback.planner.chain.kinematics import Poses, forward_kinematics
from foldback.planner.chain.module import Piece
from foldback.planner.chain.path import Path as CellPath
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.planner.errors import InputError
from foldback.web.palette import error_colours
from foldback.web.pictures.camera import distance_needed, framing
from foldback.web.static_files import STATIC, scripts_of
from foldback.web.timeline.columns import encode
from foldback.web.timeline.frame_batch import batch_of
from foldback.web.timeline.view import TimelineView
from foldback.web.timeline.window_columns import (
    PLANE_COLUMNS,
    SHORT_COLUMNS,
    window_columns,
)
from foldback.web.viser.scene_bundle import bundle_of
from foldback.words.quantities import number, si
from tests.planner import peels
from tests.planner.brackets import BRACKETS
from tests.planner.chains import chain_of
from tests.web import long_folds
from tests.web.conftest import SNAKE
from tests.web.node import NODE
from tests.web.timeline.decoding import windows_of

ROOT = Path(__file__).parents[2]
LONG = peels.snake((6, 6, 30))
CHAINS = {
    "cubes": chain_of(SNAKE, name="snake"),
    "tetrahedra": Chain.from_angles(
        TETRAHEDRON, np.deg2rad([90.0, -90, 0, 90, 90, 0, -90]), name="chain"
    ),
    "prisms": Chain.from_angles(
        module_named("snake-prism"), np.deg2rad([90.0, 0, 0, -90, 90, 0, 0, 0]), name="prisms"
    ),
    "brackets": Chain.from_angles(
        BRACKETS, np.deg2rad([40.0, 0, -40, 0, 50, 0, -40]), name="brackets"
    ),
}
LONG_CHAINS = {
    "cubes": LONG,
    "tetrahedra": Chain.from_angles(
        TETRAHEDRON, np.deg2rad(np.resize([90.0, -90.0, 0.0, 40.0], 300)), name="long"
    ),
}
FILMS = (*("wrench-24", "tetra-ring", "direct-mallet-64", "letter-l", "box-4x4x4", "tetra-bar"),)
SHIPPED = ("mallet-24", "tetra-letter-f", "refold")
"""Recordings of cubes, tetrahedra and a refold, whose drawn poses are compared."""
FILES = sorted((Path(__file__).parent / "js").glob("*.test.js"))
Vectors = Mapping[str, Any]
Cases = list[ElementTree.Element]
"""Tests of scripts, each with its file, its name and its failure."""


def text(message: bytes) -> str:
    return base64.b64encode(message).decode()


def packed(header: Mapping[str, Any] | None = None, /, **arrays: NDArray[Any]) -> str:
    return text(encode(header or {}, {k: np.asarray(v, "<f8") for k, v in arrays.items()}))


def encoded(poses: Poses, **extra: NDArray[Any]) -> str:
    return packed(positions=poses.positions, wxyzs=poses.wxyzs, **extra)


def kinematics() -> list[Vectors]:
    vectors: list[Vectors] = []
    for name, chain in CHAINS.items():
        rng = np.random.default_rng(3)
        angles = rng.uniform(-1.5, 1.5, len(chain.folded_rad))
        position = rng.uniform(-3, 3, 3)
        wxyz = rng.normal(size=4)
        wxyz /= np.linalg.norm(wxyz)
        given_encoded = encoded(
            chain.poses(angles, position, wxyz), angles=angles, position=position, wxyz=wxyz
        )
        vectors.append({"name": name, "bundle": text(bundle_of(chain)), "given": given_encoded})
    return vectors


def is_inside(piece: Piece, points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return (n,) flags of the (n, 3) points that lie in a part of a piece."""
    inside = np.zeros(len(points), dtype=bool)
    for part in piece.parts:
        heights, reach = part.corners @ part.face_normals.T, points @ part.face_normals.T
        within = (reach >= heights.min(axis=0)) & (reach <= heights.max(axis=0))
        inside |= within.all(axis=1)
    return inside


def picking() -> list[Vectors]:
    vectors: list[Vectors] = []
    for name, chain in CHAINS.items():
        poses = chain.folded_poses
        rng = np.random.default_rng(4)
        origin = poses.positions.mean(axis=0) + [9.0, -7.0, 8.0]
        targets = poses.positions[rng.integers(0, len(chain), 24)]
        ways = targets + rng.normal(0, 0.6, (24, 3)) - origin
        # Find the first of many points along the ray that lies in a module.
        spots = origin + np.linspace(0.5, 1.5, 10_001)[:, None, None] * ways
        turns = matrix_from_wxyz(poses.wxyzs)
        modules: list[int | None] = []
        for k in range(len(ways)):
            inner = np.einsum("mji,tmj->tmi", turns, spots[:, None, k] - poses.positions)
            inside = np.stack(
                [is_inside(chain.module.piece(m), inner[:, m]) for m in range(len(chain))], axis=1
            )
            first = np.flatnonzero(inside.any(axis=1))
            modules.append(int(inside[first[0]].argmax()) if len(first) else None)
        assert len(set(modules)) > 3
        assert None in modules
        data = {"name": name, "bundle": text(bundle_of(chain)), "given": encoded(poses)}
        vectors.append(
            data | {"origin": origin.tolist(), "ways": ways.tolist(), "modules": modules}
        )
    return vectors


def windows() -> list[Vectors]:
    vectors: list[Vectors] = []
    for name, chain in LONG_CHAINS.items():
        off = 1e-3 if name == "cubes" else 0.0
        windows = long_folds.fold(chain, width=31, step=3.7, base_moves=True, error_rad=off)
        columns = window_columns(windows, chain.folded_rad)
        rows = windows_of(columns, chain.folded_rad)
        angles, errors = rows.angles(chain), rows.joint_errors(chain)
        frames: list[Vectors] = []
        count = len(rows)
        for frame in (0.0, 1.0, count / 5, count / 3 + 0.25, 0.75 * count, count - 1.0):
            low, share = int(frame), frame % 1
            high = min(low + 1, count - 1)
            q, at, turn = (
                v[low] + share * (v[high] - v[low])
                for v in (angles, rows.anchor_position, rows.anchor_wxyz)
            )
            poses = forward_kinematics(
                chain.module, q, root_position=at, root_wxyz=turn / np.linalg.norm(turn)
            )
            frames.append({"frame": frame, "poses": encoded(poses, angles=q, errors=errors[low])})
        header = {"start": 0, "stop": len(windows), "stride": 1}
        batch = encode(header, columns, planes=PLANE_COLUMNS, short=SHORT_COLUMNS)
        bundle = text(bundle_of(chain, 40))
        vectors.append({"name": name, "bundle": bundle, "batch": text(batch), "frames": frames})
    return vectors


def touching() -> Vectors:
    cells = np.rint(LONG.folded_poses.positions).astype(int)
    place = {tuple(cell): k for k, cell in enumerate(cells.tolist())}
    sides = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    beside = np.array(
        [[place.get(tuple(cell + side), len(cells)) for side in sides] for cell in cells]
    )
    buried = np.maximum(beside.max(axis=1), np.arange(len(cells))) + 1
    assert 0 < (buried <= len(cells)).sum() < len(cells)
    return {
        "bundle": text(bundle_of(LONG, 40)),
        "beside": np.sort(beside, axis=1).tolist(),
        "buried": buried.tolist(),
    }


def paths() -> list[Vectors]:
    """Return lists of cells, and the error of each as a path."""
    rng = np.random.default_rng(7)
    vectors: list[Vectors] = []
    for count in np.resize([2, 3, 6, 12], 80):
        steps = np.eye(3, dtype=int)[rng.integers(0, 3, count)] * rng.choice([-1, 1], (count, 1))
        steps[rng.random(count) < 0.05] *= 2
        cells = 5 + np.cumsum(steps, axis=0)
        if cells.min() < 0 or cells.max() > 9:
            continue
        code = None
        try:
            CellPath.from_cells(cells)
        except InputError as error:
            code = error.code
        vectors.append({"cells": cells.tolist(), "code": code})
    assert {None, "repeated-cell", "not-adjacent"} <= {vector["code"] for vector in vectors}
    return vectors


def camera() -> list[Vectors]:
    vectors: list[Vectors] = []
    for stretch in ((1.0, 1.0, 1.0), (40.0, 0.3, 0.2), (0.2, 3.0, 25.0)):
        for count, aspect in ((300, 1.7), (5000, 0.5)):
            points = np.random.default_rng(5).normal(size=(count, 3)) * stretch + [1.0, -2.0, 0.5]
            seeing = {"radius": 0.9, "aspect": aspect}
            view = framing(points, **seeing)
            field, home, elevation = np.deg2rad([32.0, -62.0, 24.0]).tolist()
            vectors.append(
                {
                    "name": f"{count} points stretched by {stretch}, {aspect} wide",
                    "points": packed(points=points),
                    "seeing": seeing | {"field": field, "home": home, "elevation": elevation},
                    "azimuth": view.azimuth_rad,
                    "target": list(view.target),
                    "distance": view.distance,
                    "needed": distance_needed(points, view, **seeing),
                    "position": list(view.position),
                }
            )
    return vectors


def stored(name: str) -> Vectors:
    """Return a recording of the paper's page with its scene bundle, and its drawn poses."""
    place = STATIC.parent / "paper" / name
    chain = chain_from_attributes(json.loads((place / "chain.json").read_bytes()))
    batch = text((place / "batch").read_bytes())
    drawn = encoded(chain.folded_poses)
    return {"name": name, "bundle": text(bundle_of(chain)), "batch": batch, "drawn": drawn}


def columns() -> Vectors:
    rng = np.random.default_rng(6)
    angles = np.cumsum(rng.normal(0, 0.02, (50, 7)), axis=0)
    errors = np.abs(rng.normal(0, 1e-4, (50, 7)))
    errors[3, 2] = np.nan
    message = encode(
        {"said": "ü"},
        {"plain": np.arange(5.0), "angles": angles, "errors": errors},
        steps={"angles": 2.0**-20},
        short=frozenset({"errors"}),
    )
    return {
        "message": text(message),
        "angles": angles.ravel().tolist(),
        "errors": [None if np.isnan(v) else float(v) for v in errors.ravel()],
    }


def colours() -> Vectors:
    shares = np.array([0.0, 0.1, 0.25, 0.5, 0.999, 1.0, 7.0, np.nan])
    return {
        "bundle": text(bundle_of(CHAINS["cubes"])),
        "shares": [None if np.isnan(v) else float(v) for v in shares],
        "errors": error_colours(shares, 1.0).ravel().tolist(),
    }


def quantities() -> list[Vectors]:
    """Return values, and their texts with two and three digits as the server writes them."""
    plain = (0.0, 1.0, 12.0, 99.96, 999.96, 1234.5678, 30000.0, 999_999.0, 1e7, 12345.5, 501.0)
    ties = (0.125, 2.5, 0.375, 1.25e-3, 112.5, 1125.0)
    small = (3.4e-5, 2.5e-5, 1.9e-6, 13e-6, 9.996e-7, 1.28e-12, 9.99e-13, 4e-13, 1e-30, 1e-4)
    random = 10.0 ** np.random.default_rng(8).uniform(-13.0, 7.0, 100)
    values = [*plain, *ties, *small, *random.tolist()]
    return [
        {"value": v, "digits": n, "si": si(v, "N·m", n), "number": number(v, n)}
        for v in (*values, *(-value for value in values if value))
        for n in (2, 3)
    ]


def timeline(path: Path) -> Vectors:
    """Return a short fold as its page gets it, and Python's values for three of its frames."""
    timeline = TimelineView(path)
    chain = timeline.chain
    frames: list[Vectors] = []
    for k in (0, len(timeline) * 3 // 5, len(timeline) - 1):
        snapshot = timeline.snapshot(k)
        errors = snapshot.module_error_rad
        frames.append(
            {
                "frame": k,
                "time_s": snapshot.time_s,
                "angles": snapshot.joint_angles_rad.tolist(),
                "poses": packed(positions=snapshot.positions, wxyzs=snapshot.wxyzs),
                "colours": error_colours(errors, timeline.error_scale_rad).ravel().tolist(),
                "errors": [None if np.isnan(v) else float(v) for v in errors],
            }
        )
    return {
        "bundle": text(bundle_of(chain)),
        "batch": text(batch_of(timeline)),
        "cells": np.rint(chain.folded_poses.positions).astype(int).tolist(),
        "joints": list(chain.joint_names),
        "frames": frames,
    }


@pytest.fixture(scope="module")
def cases(timeline_path: Path, peeled: Path, tmp_path_factory: pytest.TempPathFactory) -> Cases:
    """Results of all tests under node, from one run."""
    vectors = {
        "kinematics": kinematics(),
        "picking": picking(),
        "windows": windows(),
        "touching": touching(),
        "camera": camera(),
        "films": [stored(name) for name in FILMS],
        "paths": paths(),
        "columns": columns(),
        "colours": colours(),
        "shipped": [stored(name) for name in SHIPPED],
        "quantities": quantities(),
        "timeline": timeline(timeline_path),
        "peeled": timeline(peeled / "timeline"),
    }
    path = tmp_path_factory.mktemp("javascript") / "vectors.json"
    path.write_text(json.dumps(vectors, allow_nan=False), encoding="utf-8")
    nodes = [NODE, "--test", "--test-isolation=none", "--test-reporter=junit", *FILES]
    environment = os.environ | {"FOLDBACK_VECTORS": str(path)}
    done = subprocess.run(nodes, env=environment, capture_output=True, text=True, check=False)
    assert done.stdout.rstrip().endswith("</testsuites>"), done.stdout + done.stderr
    return list(ElementTree.fromstring(done.stdout).iter("testcase"))


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name.removesuffix(".test.js"))
def test_scripts(cases: Cases, file: Path) -> None:
    results = [case for case in cases if case.get("file") == str(file)]
    assert results, cases
    failed = [
        f"{case.get('name')}\n{failure}"
        for case in results
        if (failure := case.findtext("failure")) is not None
    ]
    assert not failed, "\n\n".join(failed)


def test_every_javascript_test_belongs_to_a_file(cases: Cases) -> None:
    assert {case.get("file") for case in cases} == {str(file) for file in FILES}


def test_every_script_is_used() -> None:
    scripts = {path.relative_to(STATIC).as_posix() for path in STATIC.rglob("*.js")}
    pages = {name for name in scripts if name.startswith("js/pages/")}
    used = {script for page in pages for script in scripts_of(page)}
    # Scripts of the 3D view's frame, of a worker, of pages of others, and those that run before a
    # page's modules are named alone.
    named_alone = {
        "foldback-fold.js",
        "js/viewer/bridge.js",
        "js/viewer/sketch_worker.js",
        "js/theme.js",
        "js/unpack.js",
    }
    assert scripts == {*used, *named_alone, *scripts_of("js/check/worker.js")}
    templates = "".join(path.read_text() for path in (ROOT / "web" / "templates").rglob("*.html"))
    named = {*re.findall(r'entry\("(\w+)"\)', templates), "api", "static_paper", "standalone"}
    assert pages == {f"js/pages/{name}.js" for name in named}


def test_node_packages_are_pinned_without_addresses() -> None:
    named = json.loads((ROOT / "package.json").read_text(encoding="utf-8"))["devDependencies"]
    locked = json.loads((ROOT / "package-lock.json").read_text(encoding="utf-8"))["packages"]
    assert {name: locked[f"node_modules/{name}"]["version"] for name in named} == named
    assert [name for name, entry in locked.items() if "resolved" in entry] == []
