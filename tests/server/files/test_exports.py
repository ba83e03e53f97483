"""A finished fold in the formats of other programs, through HTTP and on the command line."""

from __future__ import annotations

import asyncio
import dataclasses
import io
import json
import os
import shutil
import threading
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import trimesh
import yourdfpy
from mcap.reader import make_reader

from planner.exports import EXPORTS, Export, export_named
from planner.plan.plan import Plan
from server.errors import NoRoom, NotFound, TooLarge, Unavailable
from server.files import exports as exports_module
from server.files.artifacts import FILES_AT_ONCE, MAX_PENDING_FILES, Artifacts
from server.files.exports import Exports
from server.pages.facts import fold_facts
from server.store.fold_files import EXPORTS_DIR
from server.store.folds import NoSuchFoldError, Store
from server.store.shown import Found
from server.store.tables import FoldRow
from tests.server.cli.test_command_line import foldback
from tests.server.rows import SOMEBODY
from tests.server.service import SNAKE, Service
from tests.server.store.test_rows import row
from words.fold import ShownFold

NAMES = [export.name for export in EXPORTS]


def directory_of(service: Service, fold: dict[str, Any]) -> Path:
    return service.directory(fold["id"])


def test_a_finished_fold_lists_all_of_them(service: Service, finished: dict[str, Any]) -> None:
    listed = service.http.get(finished["state"]["links"]["exports"]).json()["exports"]
    assert [one["name"] for one in listed] == NAMES
    assert [one["media_type"] for one in listed] == [one.media_type for one in EXPORTS]
    facts = service.http.get(f"/folds/{finished['id']}/facts").json()
    assert facts["downloads"] == [
        {key: one[key] for key in ("label", "hint", "href")} for one in listed
    ]


@pytest.mark.parametrize("name", NAMES)
def test_each_can_be_downloaded(service: Service, finished: dict[str, Any], name: str) -> None:
    export = export_named(name)
    href = f"/api/folds/{finished['id']}/exports/{name}"
    answer = service.http.get(href)
    assert answer.status_code == 200, answer.text
    assert answer.headers["content-type"] == export.media_type
    saved_as = export.filename if export.shared else f"path-{export.filename}"
    assert answer.headers["content-disposition"] == f'attachment; filename="{saved_as}"'
    directory = directory_of(service, finished)
    own = directory / export.filename
    assert (
        answer.content == (own if own.exists() else directory / EXPORTS_DIR / own.name).read_bytes()
    )
    assert not list((directory / EXPORTS_DIR).glob(".*"))
    plan = Plan.load(directory / "plan.npz")
    _read(name, answer.content, plan)
    assert service.http.get(href).content == answer.content


def _read(name: str, data: bytes, plan: Plan) -> None:
    """Reads a file with somebody else's program; more of that is tested with the planner."""
    import pandas  # loaded only where it is used: it takes long

    frames = len(plan.time_s)
    match name:
        case "json":
            assert len(json.loads(data)["time_s"]) == frames
        case "npz":
            assert len(np.load(io.BytesIO(data), allow_pickle=False)["time_s"]) == frames
        case "csv":
            assert len(pandas.read_csv(io.BytesIO(data))) == frames
        case "mjcf":
            assert mujoco.MjModel.from_xml_string(data.decode()).nkey == 7
        case "urdf":
            robot: Any = yourdfpy.URDF.load(io.BytesIO(data))
            assert tuple(robot.actuated_joint_names) == plan.chain.joint_names
        case "mcap":
            found = make_reader(io.BytesIO(data)).get_summary()
            assert found.statistics.message_count == 2 * frames + 2
        case "glb":
            scene: Any = trimesh.load_scene(io.BytesIO(data), file_type="glb")
            assert len(scene.graph.nodes_geometry) == len(plan.chain)
        case "srdf":
            pairs = data.count(b"<disable_collisions")
            assert pairs == len(plan.chain.module.exempt_pairs(len(plan.chain)))
        case "stl" | "obj":
            assert trimesh.load_mesh(io.BytesIO(data), file_type=name).is_watertight
        case _:
            raise AssertionError(f"{name} is not read by this test")


@pytest.mark.parametrize("name", ["dae", "plan.json", "URDF", "%2e%2e", ".%2fplan", "u" * 4000])
def test_what_there_is_not_is_not_found(
    service: Service, finished: dict[str, Any], name: str
) -> None:
    answer = service.http.get(f"/api/folds/{finished['id']}/exports/{name}")
    assert answer.status_code == 404
    assert len(answer.text) < 500
    if name == "dae":
        assert answer.json()["code"] == "no-such-export"
        assert ", ".join(NAMES) in answer.json()["detail"]


def test_a_fold_that_is_not_over_says_so(desk: Service) -> None:
    fold_id = desk.fold(SNAKE, seed="70")["id"]
    for part in ("exports", "exports/urdf", "exports/json"):
        answer = desk.http.get(f"/api/folds/{fold_id}/{part}")
        assert (answer.status_code, answer.json()["code"]) == (409, "not-ready")
        assert answer.headers["retry-after"]
    assert desk.http.get("/api/folds/nosuchfold/exports/urdf").status_code == 404
    assert desk.http.get(f"/folds/{fold_id}/facts").json()["downloads"] == []


@pytest.fixture
def fold(store: Store, service: Service, finished: dict[str, Any]) -> FoldRow:
    """A row whose directory has a real plan and nothing else, as if from long ago."""
    added = row(status="verified", summary=finished["state"]["summary"])
    store.add(added, SOMEBODY)
    store.directory(added.id).mkdir()
    shutil.copy(directory_of(service, finished) / "plan.npz", store.directory(added.id))
    return added


def exports_in(store: Store, free: int = 0) -> Exports:
    return Exports(store, Artifacts(store, min_free_disk_bytes=free))


def test_a_model_that_the_fold_wrote_itself_is_kept(store: Store, fold: FoldRow) -> None:
    """One without keys on the way, as older folds have, is exported as it is."""
    directory = store.directory(fold.id)
    made = asyncio.run(exports_in(store).file(fold.id, export_named("mjcf")))
    assert made == directory / EXPORTS_DIR / "model.xml"
    (directory / "model.xml").write_text("<mujoco/>")
    kept = asyncio.run(exports_in(store).file(fold.id, export_named("mjcf")))
    assert kept == directory / "model.xml"


def test_few_are_made_at_once_and_each_once(store: Store, fold: FoldRow) -> None:
    may_end = threading.Event()
    made: list[str] = []

    def slow(name: str) -> Export:
        def write(plan: Plan) -> bytes:
            made.append(name)
            assert may_end.wait(30.0)
            return name.encode()

        filename = f"{name}.txt"
        return dataclasses.replace(EXPORTS[0], name=name, filename=filename, write=write)

    async def ask() -> None:
        exports = exports_in(store)
        slows = [slow(f"slow_{k}") for k in range(MAX_PENDING_FILES)]
        asked = [
            asyncio.create_task(exports.file(fold.id, one)) for one in (*slows, *slows, *slows)
        ]
        while len(made) < FILES_AT_ONCE:
            await asyncio.sleep(0.01)
        with pytest.raises(Unavailable) as refused:
            await exports.file(fold.id, slow("one_more"))
        assert refused.value.code == "busy"
        assert (refused.value.retry_after_s or 0) > 0
        assert len(made) == FILES_AT_ONCE  # the others wait
        asked[0].cancel()  # its file is made for the others all the same
        may_end.set()
        paths = await asyncio.gather(*asked[1:])
        names = [one.name for one in slows]
        assert sorted({path.read_text() for path in paths}) == names
        assert sorted(made) == names
        assert (await exports.file(fold.id, slow("one_more"))).read_text() == "one_more"

    asyncio.run(ask())


def test_a_file_older_than_its_plan_is_made_anew(store: Store, fold: FoldRow) -> None:
    export = export_named("stl")
    path = asyncio.run(exports_in(store).file(fold.id, export))
    right = path.read_bytes()
    path.write_bytes(b"kept")
    assert asyncio.run(exports_in(store).file(fold.id, export)).read_bytes() == b"kept"
    later = path.stat().st_mtime + 1.0
    os.utime(store.directory(fold.id) / "plan.npz", (later, later))
    assert asyncio.run(exports_in(store).file(fold.id, export)).read_bytes() == right


def test_what_cannot_be_made_is_a_clear_answer(store: Store, fold: FoldRow) -> None:
    with pytest.raises(NoRoom):
        asyncio.run(exports_in(store, free=2**62).file(fold.id, export_named("stl")))
    store.delete(fold.id)
    with pytest.raises(NoSuchFoldError):
        asyncio.run(exports_in(store).file(fold.id, export_named("stl")))
    assert not store.directory(fold.id).exists()  # nothing is left of a fold that was deleted
    with pytest.raises(NotFound) as gone:
        asyncio.run(exports_in(store).file(fold.id, export_named("urdf")))
    assert gone.value.code == "no-such-artifact"


def test_plans_too_large_for_the_service_are_for_the_command_line(
    store: Store, fold: FoldRow, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exports_module, "MAX_EXPORTED_PLAN_BYTES", 10_000)
    for name in ("csv", "mcap", "json"):
        with pytest.raises(TooLarge) as refused:
            asyncio.run(exports_in(store).file(fold.id, export_named(name)))
        assert "foldback export" in refused.value.detail
    assert asyncio.run(exports_in(store).file(fold.id, export_named("urdf"))).is_file()


def test_a_plan_without_frames_offers_no_motion(store: Store, fold: FoldRow) -> None:
    fold.summary = {**fold.summary, "playback": None}
    downloads = fold_facts(Found(ShownFold.of(fold), store.directory(fold.id)))["downloads"]
    assert [one["href"].rpartition("/")[2] for one in downloads] == [
        one.name for one in EXPORTS if not one.moving
    ]
    assert (
        fold_facts(Found(ShownFold.of(fold), store.directory(fold.id)), api=False)["downloads"]
        == []
    )


def test_the_command_writes_what_is_asked_for(
    service: Service, finished: dict[str, Any], tmp_path: Path
) -> None:
    directory, out = str(directory_of(service, finished)), tmp_path / "a" / "b"
    answer = foldback("export", directory, "--as", "urdf, stl", "--out", str(out), "--json")
    assert answer.returncode == 0, answer.stderr
    sizes = json.loads(answer.stdout.splitlines()[-1])["bytes"]
    assert sizes == {path.name: path.stat().st_size for path in out.iterdir()}
    assert set(sizes) == {"model.urdf", "module.stl"}
    everything = foldback("export", directory, "--out", str(tmp_path / "all"))
    assert everything.returncode == 0, everything.stderr
    files = {path.name for path in (tmp_path / "all").iterdir()}
    assert files == {export.filename for export in EXPORTS}


def test_the_command_says_what_is_wrong(tmp_path: Path) -> None:
    out = str(tmp_path / "out")
    unknown = foldback("export", str(tmp_path), "--as", "urdf,dae", "--out", out)
    assert unknown.returncode == 2
    assert f"'dae', expected one of: {', '.join(NAMES)}" in unknown.stderr
    missing = foldback("export", str(tmp_path), "--out", out)
    assert missing.returncode == 2
    assert "plan.npz" in missing.stderr
    assert not (tmp_path / "out").exists()
