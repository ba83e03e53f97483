"""Frames, files and embeds of a fold through a real service."""

import numpy as np

from foldback.planner.motion.timeline import Timeline
from foldback.web.viser.scene_bundle import opened_scene
from tests.server.service_process import Service
from tests.web.blog import Blog


def test_finished_frames_and_the_client_are_cached_by_browsers(
    service: Service, wrench: str
) -> None:
    tags: set[str] = set()
    for path in (f"/folds/{wrench}/bundle", f"/folds/{wrench}/batch?stride=3", "/view"):
        first = service.http.get(path)
        tags.add(first.headers["ETag"])
        second_response = service.http.get(path, headers={"If-None-Match": first.headers["ETag"]})
        assert (first.status_code, second_response.status_code, second_response.content) == (
            200,
            304,
            b"",
        ), path
    assert service.http.get(f"/folds/{wrench}/batch?stride=2").headers["ETag"] not in tags
    assert b"window.Worker = " in first.content


def test_unknown_comparisons_and_invalid_queries_are_refused(service: Service, wrench: str) -> None:
    assert service.http.get("/compare?a=nosuchfold&b=nosuchfold").status_code == 404
    wrong = ("from=-1", "stride=0", "wait=999", "from=x", "to=-3")
    queries = [f"/folds/{wrench}/batch?{query}" for query in wrong]
    for path in (*queries, "/compare?a=%3Cscript%3E&b=x"):
        assert service.http.get(path).status_code == 422, path


def test_files_are_sandboxed_downloads_and_made_once(service: Service, wrench: str) -> None:
    exports_directory = service.directory(wrench) / "exports"
    for name, kind, pattern in (
        ("standalone.html", "text/html", "standalone-*.html"),
        ("recording.viser", "octet-stream", "recording.viser"),
    ):
        answer = service.http.get(f"/folds/{wrench}/{name}")
        assert answer.status_code == 200
        assert kind in answer.headers["Content-Type"]
        assert answer.headers["Content-Disposition"].startswith("attachment; filename=")
        assert "sandbox" in answer.headers["Content-Security-Policy"]
        (path,) = exports_directory.glob(pattern)
        assert path.read_bytes() == answer.content
        path.write_bytes(b"as it was left")
        assert service.http.get(f"/folds/{wrench}/{name}").content == b"as it was left"
        path.unlink()


def test_recording_is_read_by_viser(service: Service, wrench: str) -> None:
    timed, buffers = opened_scene(service.http.get(f"/folds/{wrench}/recording.viser").content)
    timeline = Timeline.open(service.directory(wrench) / "timeline")
    places = [
        (t, m["updates"]["batched_positions"])
        for t, m in timed
        if m["type"] == "SceneNodeUpdateMessage"
        and m["name"] == "/modules"
        and "batched_positions" in m["updates"]
    ]
    assert len({t for t, _ in places}) >= len(timeline) - 3  # constant values are not repeated
    change = places[-1][1]
    last = np.frombuffer(buffers[change["__binary_index"]], change["dtype"]).reshape(-1, 3)
    frame = timeline.frames(len(timeline) - 1)
    poses = timeline.chain.poses(frame.joint_angles_rad, frame.root_position, frame.root_wxyz)
    assert np.allclose(last / 0.25, poses.positions[0], atol=1e-5)


def test_only_named_sites_may_frame_an_embed(service: Service, blog: Blog, wrench: str) -> None:
    for path in (f"/embed/{wrench}", "/embed/view"):
        policy = service.http.get(path).headers["Content-Security-Policy"]
        assert f"frame-ancestors 'self' {blog.origin}" in policy
    for path in (f"/folds/{wrench}", "/", "/view"):
        policy = service.http.get(path).headers["Content-Security-Policy"]
        assert blog.origin not in policy
        assert "frame-ancestors 'self'" in policy
