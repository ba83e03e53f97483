"""Frames, sharing and comparing through a real service, and through ``foldback play``."""

from __future__ import annotations

import json
import re

import httpx
import numpy as np
import pytest

from bench.command import playing
from planner.motion.timeline import Timeline
from tests.server.service import SNAKE, Service
from tests.web.blog import Blog
from web.timeline.columns import decode
from web.viser.scene_bundle import opened_scene


@pytest.fixture(scope="module")
def fold(service: Service) -> str:
    accepted = service.fold(SNAKE)
    assert service.wait_over(accepted["id"])["status"] == "verified"
    return accepted["id"]


def test_whole_fold_comes_in_batches(service: Service, fold: str) -> None:
    timeline = Timeline.open(service.directory(fold) / "timeline.zarr")
    frames = timeline.frames()
    angles = []
    at = 0
    while at < len(timeline):
        header, arrays = decode(
            service.http.get(f"/folds/{fold}/batch?from={at}&to={at + 77}").content
        )
        assert header["start"] == at
        angles.append(arrays["joint_angles_rad"])
        at = header["stop"]
    assert np.allclose(np.concatenate(angles), frames.joint_angles_rad, atol=6e-7)
    bundle, _ = decode(service.http.get(f"/folds/{fold}/bundle").content)
    assert bundle["chain"]["modules"] == 16


def test_finished_frames_and_the_client_are_cached_by_browsers(service: Service, fold: str) -> None:
    tags: set[str] = set()
    for path in (f"/folds/{fold}/bundle", f"/folds/{fold}/batch?stride=3", "/view"):
        first = service.http.get(path)
        tags.add(first.headers["ETag"])
        again = service.http.get(path, headers={"If-None-Match": first.headers["ETag"]})
        assert (first.status_code, again.status_code, again.content) == (200, 304, b""), path
    assert service.http.get(f"/folds/{fold}/batch?stride=2").headers["ETag"] not in tags
    assert b"window.Worker = " in first.content


def test_frames_and_figures_are_empty_until_computed(service: Service) -> None:
    waiting = service.fold(SNAKE, seed=7)
    answers = {service.http.get(f"/folds/{waiting['id']}/batch").status_code for _ in range(2)}
    assert answers <= {204, 200}
    assert service.http.get(f"/folds/{waiting['id']}/figures").status_code in (204, 200)
    service.wait_over(waiting["id"])
    assert service.http.get(f"/folds/{waiting['id']}/batch").status_code == 200
    assert service.http.get(f"/folds/{waiting['id']}/figures").status_code == 200


def test_unknown_folds_and_invalid_queries_are_refused(service: Service, fold: str) -> None:
    names = ("batch", "bundle", "figures", "standalone.html", "recording.viser")
    unknown = [f"/folds/nosuchfold/{name}" for name in names]
    for path in (*unknown, "/embed/nosuchfold", "/compare?a=nosuchfold&b=nosuchfold"):
        assert service.http.get(path).status_code == 404, path
    for query in ("from=-1", "stride=0", "wait=999", "from=x", "to=-3"):
        assert service.http.get(f"/folds/{fold}/batch?{query}").status_code == 422, query


def test_files_are_sandboxed_downloads_and_made_once(service: Service, fold: str) -> None:
    kept = service.directory(fold) / "exports"
    for name, kind, pattern in (
        ("standalone.html", "text/html", "standalone-*.html"),
        ("recording.viser", "octet-stream", "recording.viser"),
    ):
        answer = service.http.get(f"/folds/{fold}/{name}")
        assert answer.status_code == 200
        assert kind in answer.headers["Content-Type"]
        assert answer.headers["Content-Disposition"].startswith("attachment; filename=")
        assert "sandbox" in answer.headers["Content-Security-Policy"]
        (path,) = kept.glob(pattern)
        assert path.read_bytes() == answer.content
        path.write_bytes(b"as it was left")
        assert service.http.get(f"/folds/{fold}/{name}").content == b"as it was left"
        path.unlink()


def test_recording_is_read_by_viser(service: Service, fold: str) -> None:
    record = service.http.get(f"/folds/{fold}/recording.viser").content
    timed, buffers = opened_scene(record)
    timeline = Timeline.open(service.directory(fold) / "timeline.zarr")
    places = [
        (t, m["updates"]["batched_positions"])
        for t, m in timed
        if m["type"] == "SceneNodeUpdateMessage"
        and m["name"] == "/modules"
        and "batched_positions" in m["updates"]
    ]
    assert len({t for t, _ in places}) >= len(timeline) - 3  # what rests is not said twice
    told = places[-1][1]
    last = np.frombuffer(buffers[told["__binary_index"]], told["dtype"]).reshape(-1, 3)
    frame = timeline.frames(len(timeline) - 1)
    poses = timeline.chain.poses(frame.joint_angles_rad, frame.root_position, frame.root_wxyz)
    assert np.allclose(last / 0.25, poses.positions[0], atol=1e-5)


def test_only_named_sites_may_frame_an_embed(service: Service, blog: Blog, fold: str) -> None:
    for path in (f"/embed/{fold}", "/embed/view"):
        policy = service.http.get(path).headers["Content-Security-Policy"]
        assert f"frame-ancestors 'self' {blog.origin}" in policy
    for path in (f"/folds/{fold}", "/", "/view"):
        policy = service.http.get(path).headers["Content-Security-Policy"]
        assert blog.origin not in policy
        assert "frame-ancestors 'self'" in policy


def test_compare_links_both_folds(service: Service, fold: str) -> None:
    page = service.http.get(f"/compare?a={fold}&b={fold}")
    assert page.status_code == 200
    assert page.text.count(f'href="/folds/{fold}"') == 2
    assert service.http.get("/compare?a=%3Cscript%3E&b=x").status_code == 422


@pytest.mark.long
def test_play_shows_a_directory(service: Service, fold: str) -> None:
    directory = service.directory(fold)
    with playing(directory) as address, httpx.Client(timeout=60) as http:
        page = http.get(address)
        assert page.status_code == 200
        found = re.search(r'id="facts">(.*?)</script>', page.text, re.DOTALL)
        facts = json.loads(found[1])
        assert facts["verdict"]["tone"] == "good"
        assert not facts["refoldable"]
        header, _ = decode(http.get(f"{address}/batch?to=3").content)
        assert header["stop"] == 3
        assert http.get(f"{address}/figures").status_code == 200
        before = set(directory.rglob("*.html"))
        assert http.get(f"{address}/standalone.html").status_code == 200
        assert set(directory.rglob("*.html")) == before
