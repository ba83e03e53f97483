"""What the page's scripts compute is what Python computes."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Page

from planner.chain import Chain
from planner.kinematics import forward_kinematics
from planner.modules import TETRAHEDRON
from planner.paths import Path as CellPath
from planner.rotations import matrix_from_wxyz
from tests.planner import peels
from tests.web import long_folds
from web.camera import distance_needed, framing
from web.columns import encode
from web.scenery import scenery_of
from web.window_columns import PLANES, window_columns, windows_of

pytestmark = [pytest.mark.browser, pytest.mark.slow]
SNAKE = [(x if y % 2 == 0 else 3 - x, y, 0) for y in range(4) for x in range(4)]
UNPACK = """
  const { decode } = await import("/static/columns.js");
  const unpack = (text) => decode(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
"""


@pytest.fixture
def page(visit: Callable[..., Page]) -> Iterator[Page]:
    yield visit("/")


def run(page: Page, script: str, *given: Any) -> Any:
    return page.evaluate(f"async (given) => {{ {UNPACK} {script} }}", list(given))


def text(message: bytes) -> str:
    return base64.b64encode(message).decode()


CHAINS = [
    Chain.from_path(CellPath.from_cells(SNAKE, name="snake")),
    Chain.from_angles(TETRAHEDRON, np.deg2rad([90.0, -90, 0, 90, 90, 0, -90]), name="chain"),
]


@pytest.mark.parametrize("chain", CHAINS, ids=["cubes", "tetrahedra"])
def test_poses(page: Page, chain: Chain) -> None:
    rng = np.random.default_rng(3)
    angles = rng.uniform(-1.5, 1.5, len(chain.folded_rad))
    position = rng.uniform(-3, 3, 3)
    wxyz = rng.normal(size=4)
    wxyz /= np.linalg.norm(wxyz)
    found = run(
        page,
        """
        const { Kinematics } = await import("/static/kinematics.js");
        const { header } = await unpack(given[0]);
        const { positions, wxyzs } = new Kinematics(header.chain).poses(...given.slice(1));
        return [Array.from(positions), Array.from(wxyzs)];
        """,
        text(scenery_of(chain)),
        angles.tolist(),
        position.tolist(),
        wxyz.tolist(),
    )
    poses = chain.poses(angles, position, wxyz)
    assert np.allclose(np.reshape(found[0], (-1, 3)), poses.positions, atol=2e-6)
    turns = np.abs(np.einsum("ij,ij->i", np.reshape(found[1], (-1, 4)), poses.wxyzs))
    assert np.allclose(turns, 1.0, atol=1e-6)


@pytest.mark.parametrize("chain", CHAINS, ids=["cubes", "tetrahedra"])
def test_picking(page: Page, chain: Chain) -> None:
    poses = chain.folded_poses
    rng = np.random.default_rng(4)
    origin = poses.positions.mean(axis=0) + [9.0, -7.0, 8.0]
    ways = poses.positions[rng.integers(0, len(chain), 12)] + rng.normal(0, 0.8, (12, 3)) - origin
    found = run(
        page,
        """
        const { picked } = await import("/static/kinematics.js");
        const { header } = await unpack(given[0]);
        const poses = { positions: given[1], wxyzs: given[2] };
        return given[4].map((way) => picked(header.chain, poses, given[3], way));
        """,
        text(scenery_of(chain)),
        poses.positions.ravel().tolist(),
        poses.wxyzs.ravel().tolist(),
        origin.tolist(),
        ways.tolist(),
    )
    # The first of many points along the ray that lies in a module.
    spots = origin + np.linspace(0.0, 2.0, 20_001)[:, None, None] * ways
    turns = matrix_from_wxyz(poses.wxyzs)
    heights = chain.module.vertices @ chain.module.face_normals.T
    for k, module in enumerate(found):
        inner = np.einsum("mji,tmj->tmi", turns, spots[:, None, k] - poses.positions)
        reach = inner @ chain.module.face_normals.T
        inside = ((reach >= heights.min(axis=0)) & (reach <= heights.max(axis=0))).all(axis=2)
        first = np.flatnonzero(inside.any(axis=1))
        assert module == (None if not len(first) else int(inside[first[0]].argmax()))
    assert len(set(found)) > 3
    assert None in found


LONG = peels.snake((6, 6, 30))
TETRAHEDRA = Chain.from_angles(
    TETRAHEDRON, np.deg2rad(np.resize([90.0, -90.0, 0.0, 40.0], 300)), name="long"
)


@pytest.mark.parametrize("chain", [LONG, TETRAHEDRA], ids=["cubes", "tetrahedra"])
def test_poses_of_windows(page: Page, chain: Chain) -> None:
    windows = long_folds.fold(chain, width=31, step=3.7, base_moves=True)
    columns = window_columns(windows, chain.folded_rad)
    frames = [0.0, 1.0, len(windows) / 5, len(windows) / 3 + 0.25, len(windows) - 1.0]
    found = run(
        page,
        """
        const { Window } = await import("/static/frames.js");
        const { Kinematics } = await import("/static/kinematics.js");
        const { header, arrays } = await unpack(given[0]);
        const foldedRad = arrays.folded_rad;
        const kinematics = new Kinematics(header.chain, foldedRad);
        const rows = new Window(await unpack(given[1]), { foldedRad, noErrors: null });
        return given[2].map((frame) => {
          const low = Math.floor(frame);
          let row = rows.row(low);
          if (frame > low) row = Window.between(row, rows.row(low + 1), frame - low);
          const { positions, wxyzs, core, rod } = Window.poses(kinematics, row);
          return [Array.from(positions), Array.from(wxyzs), core, rod];
        });
        """,
        text(scenery_of(chain, 40)),
        text(encode({"start": 0, "stop": len(windows), "stride": 1}, columns, planes=PLANES)),
        frames,
    )
    told = windows_of(columns, chain.folded_rad)
    straight = folded = 0
    for frame, (positions, wxyzs, core, rod) in zip(frames, found, strict=True):
        low, share = int(frame), frame % 1
        angles = told.angles(chain)
        at, turn = told.base_position, told.base_wxyz
        if share:
            angles, at, turn = (v[low] + share * (v[low + 1] - v[low]) for v in (angles, at, turn))
        else:
            angles, at, turn = angles[low], at[low], turn[low]
        poses = forward_kinematics(
            chain.module, angles, root_position=at, root_wxyz=turn / np.linalg.norm(turn)
        )
        # Both ends are told in single precision, and the far one is far away.
        length = np.abs(poses.positions).max()
        off = np.abs(np.reshape(positions, (-1, 3)) - poses.positions).max()
        assert off < 1e-6 * max(1.0, length)
        turns = np.abs(np.einsum("ij,ij->i", np.reshape(wxyzs, (-1, 4)), poses.wxyzs))
        assert np.allclose(turns, 1.0, atol=1e-6)
        assert 1 <= core <= rod + 1 <= len(chain)
        straight, folded = max(straight, len(chain) - rod), max(folded, core)
    assert straight > 100
    assert folded == len(chain)


def test_faces_that_touch(page: Page) -> None:
    cells = np.rint(LONG.folded_poses.positions).astype(int)
    neighbours, buried = run(
        page,
        """
        const { touching, buriedBy } = await import("/static/touching.js");
        const { Kinematics } = await import("/static/kinematics.js");
        const { header, arrays } = await unpack(given[0]);
        const { folded } = new Kinematics(header.chain, arrays.folded_rad);
        const found = touching(header, folded);
        return [Array.from(found), Array.from(buriedBy(found, header.chain.modules))];
        """,
        text(scenery_of(LONG, 40)),
    )
    place = {tuple(cell): k for k, cell in enumerate(cells.tolist())}
    sides = np.concatenate([np.eye(3, dtype=int), -np.eye(3, dtype=int)])
    beside = [[place.get(tuple(cell + side), len(cells)) for side in sides] for cell in cells]
    found = np.reshape(neighbours, (len(cells), 6))
    assert np.array_equal(np.sort(found, axis=1), np.sort(beside, axis=1))
    expected = np.maximum(np.max(beside, axis=1), np.arange(len(cells))) + 1
    assert np.array_equal(buried, expected)
    assert 0 < (expected <= len(cells)).sum() < len(cells)


@pytest.mark.parametrize("aspect", [1.7, 0.5])
@pytest.mark.parametrize("count", [300, 5000])
@pytest.mark.parametrize("stretch", [(1.0, 1.0, 1.0), (40.0, 0.3, 0.2), (0.2, 3.0, 25.0)])
def test_the_camera(page: Page, aspect: float, count: int, stretch: tuple[float, ...]) -> None:
    rng = np.random.default_rng(5)
    points = rng.normal(size=(count, 3)) * stretch + [1.0, -2.0, 0.5]
    found = run(
        page,
        """
        const { framing, distanceNeeded, positionOf } = await import("/static/camera.js");
        const [points, aspect, field, home, elevation] = given;
        const seeing = { radius: 0.9, aspect, field, home };
        const view = framing(points, { ...seeing, elevation });
        return [
          view.azimuth, ...view.target, view.distance, distanceNeeded(points, view, seeing),
          ...positionOf(view),
        ];
        """,
        points.ravel().tolist(),
        aspect,
        float(np.deg2rad(32.0)),
        float(np.deg2rad(-62.0)),
        float(np.deg2rad(24.0)),
    )
    view = framing(points, radius=0.9, aspect=aspect)
    needed = distance_needed(points, view, radius=0.9, aspect=aspect)
    expected = [view.azimuth_rad, *view.target, view.distance, needed, *view.position]
    assert np.allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_the_camera_between_views(page: Page) -> None:
    glides, rests, there, first, second, mixed, angles = run(
        page,
        """
        const { Follower, anglesOf, blended, framing, positionOf } =
          await import("/static/camera.js");
        const seeing = { radius: 0.9, aspect: 1.6, field: 0.56, home: -1 };
        const from = framing(given[0], { ...seeing, elevation: 0.4 });
        const to = framing(given[0].map((v) => v + 30), { ...seeing, elevation: 0.4, azimuth: 3 });
        const follower = new Follower();
        follower.aim(from);
        follower.aim(to);
        let steps = 0;
        while (follower.move(1 / 30) && steps < 300) steps++;
        const mixed = blended([from, to], [1, 1], from);
        return [
          steps, follower.move(1), follower.view === to, from, to, mixed,
          anglesOf(positionOf(from), from.target),
        ];
        """,
        (np.random.default_rng(0).normal(size=90) * 5).tolist(),
    )
    assert 5 < glides < 300
    assert not rests
    assert there
    aside = np.linalg.norm(np.subtract(mixed["target"], first["target"]))
    assert mixed["target"] == pytest.approx(np.add(first["target"], second["target"]) / 2)
    assert mixed["distance"] >= first["distance"] + aside  # what is nearest stays in the picture
    assert angles == pytest.approx([first["azimuth"], 0.4])


def test_packed_columns(page: Page) -> None:
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
    header, plain, found, short = run(
        page,
        """
        const { header, arrays } = await unpack(given[0]);
        return [header, Array.from(arrays.plain), Array.from(arrays.angles),
          Array.from(arrays.errors, (v) => (Number.isNaN(v) ? null : v))];
        """,
        text(message),
    )
    assert header == {"said": "ü"}
    assert plain == [0, 1, 2, 3, 4]
    assert np.allclose(np.reshape(found, angles.shape), angles, atol=6e-7)
    told = np.array([np.nan if v is None else v for v in short]).reshape(errors.shape)
    assert np.allclose(told, errors, rtol=1 / 256, equal_nan=True)


FILMED = """
  const { Film } = await import("/static/film.js");
  const [swaps, over] = given;
  const chain = { modules: 2, root: 0, rigid_links: 0, hinges: 1, axes: [[0, 0, 1]],
    anchor: [0.5, 0, 0], offset: [0.5, 0, 0], turn: [1, 0, 0, 0] };
  const arrays = { folded_rad: new Float32Array(1), folded_positions: new Float32Array(6) };
  let calls = 0;
  const source = {
    scenery: async () => ({ header: { chain }, arrays }),
    reel: async ({ from = 0, to = null, stride = 1 }) => {
      calls++;
      const id = `timeline ${swaps.filter((at) => calls > at).length}`;
      const total = 400;
      const stop = Math.min(total, to ?? total);
      const rows = Math.ceil((stop - from) / stride);
      const column = (width) => new Float32Array(rows * width);
      return {
        header: { id, status: "growing", total, start: from, stop, stride, outline: {},
          ...(over ? {} : { status: "complete" }) },
        arrays: { time_s: column(1), phase: column(1), root_position: column(3),
          root_wxyz: column(4), joint_angles_rad: column(1), joint_error_rad: column(1) },
      };
    },
  };
  const film = new Film(source, { over });
  await new Promise((done) => setTimeout(done, 2500));
  if (!over) film.finish();
  await new Promise((done) => setTimeout(done, 300));
  film.stop();
  return [film.id, film.complete, film.total, calls];
"""


@pytest.mark.parametrize("swaps", [[], [2], [4], [4, 9]])
def test_a_timeline_begun_anew_is_shown_to_its_end(page: Page, swaps: list[int]) -> None:
    name, complete, total, calls = run(page, FILMED, swaps, False)
    assert (name, complete, total) == (f"timeline {len(swaps)}", True, 400)
    assert calls < 60  # it waits between looking and looking again


def test_a_fold_that_ended_in_the_middle_is_over(page: Page) -> None:
    name, complete, total, calls = run(page, FILMED, [], True)
    assert (complete, total) == (True, 400)
    assert calls < 20


def test_nonsense_from_the_view_is_not_believed(page: Page) -> None:
    heard, camera, keys = run(
        page,
        """
        const { Scene } = await import("/static/scene.js");
        const heard = [];
        const frame = document.createElement("iframe");
        const keys = [];
        frame.addEventListener("keydown", ({ key, shiftKey }) => keys.push([key, shiftKey]));
        const scene = new Scene(frame, { touch: () => heard.push("touch") }, ["End"]);
        scene.scenery = {};
        scene.pick = (...ray) => heard.push(ray);
        const bad = [[NaN, 0, 0], [0, 0, Infinity], [1e300, 0, 0], [0, 0], [0, 0, 0, 0], "abc",
          null, ["1", "2", "3"], { length: 3 }, [[], [], []], new Float32Array(3)];
        for (const vector of bad) {
          scene.hear({ is: "camera", position: vector, target: [0, 0, 0] });
          scene.hear({ is: "camera", position: [0, 0, 1], target: vector });
          scene.hear({ is: "pick", origin: vector, direction: [0, 0, 1] });
          scene.hear({ is: "pick", origin: [0, 0, 1], direction: vector });
        }
        scene.hear({ is: "camera", position: [1, 2, 3], target: [1, 2, 3] }); // looks nowhere
        for (const told of [null, 1, "open", [], {}, { is: "constructor" }, { is: "done", id: "x" },
          { is: "key", key: "F5" }, { is: "key", key: ["End"] }]) scene.hear(told);
        const nothing = [heard.length, scene.camera, keys.length];
        scene.hear({ is: "camera", position: [1, 2, 3], target: [0, 0, 0] });
        scene.hear({ is: "pick", origin: [1, 2, 3], direction: [0, 0, -1] });
        scene.hear({ is: "touch" });
        scene.hear({ is: "key", key: "End", shift: "yes" });
        return [[nothing, heard], scene.camera, keys];
        """,
    )
    assert heard == [[0, None, 0], [[[1, 2, 3], [0, 0, -1]], "touch"]]
    assert camera == {"position": [1, 2, 3], "target": [0, 0, 0]}
    assert keys == [["End", False]]


def test_no_script_is_left_unused() -> None:
    static = Path(__file__).parents[2] / "web" / "static"
    named = "".join(
        path.read_text(encoding="utf-8")
        for folder in (
            static,
            static.parent / "templates",
            static.parent,
            static.parents[1] / "server" / "routes",
        )
        for path in sorted(folder.iterdir())
        if path.suffix in {".js", ".html", ".py"}
    )
    unused = [path.name for path in static.glob("*.js") if named.count(path.name) == 0]
    assert unused == []
