"""A fold in a separate viser server."""

import socket
import threading
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import viser

from foldback import Plan, fold
from foldback.planner.chain.chain import Chain
from foldback.planner.errors import TimelineError
from foldback.planner.motion.timeline import Timeline
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.progress import Progress
from foldback.viewer import Live, Shown, show
from foldback.web.palette import (
    NO_ERROR_RGB,
    SELECTED_RGB,
    error_colours,
    instance_colours,
    ramp_colours,
)
from foldback.web.timeline.view import MotionMoments, TimelineView
from foldback.web.viser.viewer import COLOUR_ALONG_CHAIN
from tests.planner.chains import chain_of
from tests.planner.peels import snake
from tests.refusal import refused
from tests.server.service_process import wait_until
from tests.web.conftest import FINAL_ERROR_RAD, SNAKE, Growing


@pytest.fixture
def shown_fold(timeline_path: Path) -> Iterator[Shown]:
    with show(timeline_path, port=0) as shown_fold:
        yield shown_fold


def colours(shown_fold: Shown) -> np.ndarray:
    """Return the (n, 3) linear bytes that clients were sent."""
    return np.asarray(shown_fold._scene._modules[0][1].batched_colors)


def positions(shown_fold: Shown) -> np.ndarray:
    return np.asarray(shown_fold._scene._modules[0][1].batched_positions) / shown_fold._scene.pitch


def distances(positions: np.ndarray) -> np.ndarray:
    """Return the (n, n) distances between all modules, since the chain floats."""
    return np.linalg.norm(positions[:, None] - positions[None], axis=-1)


def linear(rgb: tuple[int, int, int]) -> list[int]:
    return instance_colours(np.array([rgb], np.uint8))[0].tolist()


def shows_positions(shown_fold: Shown) -> bool:
    """Return True if the colours show the positions in the chain."""
    modules = len(colours(shown_fold))
    ramp = ramp_colours(np.linspace(0.0, 1.0, modules))
    return bool((colours(shown_fold) == instance_colours(ramp)).all())


def test_frames_are_posed_as_in_the_timeline(shown_fold: Shown, timeline_path: Path) -> None:
    assert type(shown_fold.server) is viser.ViserServer
    assert shown_fold.url == f"http://127.0.0.1:{shown_fold.server.get_port()}"
    view = TimelineView(timeline_path)
    for frame in (0, 40, 199):
        shown_fold.frame = frame
        assert np.allclose(positions(shown_fold), view.snapshot(frame).positions, atol=1e-6)
        assert shown_fold._controls.slider.value == frame + 1  # counted from 1
        assert f"Frame {frame + 1} of 200" in shown_fold._controls.text.content
    for request, clamped_frame in ((-5, 0), (10**12, 199)):
        shown_fold.frame = request
        assert shown_fold.frame == shown_fold._controls.slider.value - 1 == clamped_frame


def test_colours_show_joint_errors_or_the_place_in_the_chain(
    shown_fold: Shown, chain: Chain
) -> None:
    shown_fold.frame = 50
    assert shows_positions(shown_fold)  # no errors while the chain unfolds
    assert "The joint error was not recorded" in shown_fold._controls.text.content
    shown_fold.frame = 199
    red = instance_colours(error_colours(np.array([FINAL_ERROR_RAD]), FINAL_ERROR_RAD))[0]
    assert colours(shown_fold)[6].tolist() == red.tolist()
    assert colours(shown_fold)[4].tolist() == linear(NO_ERROR_RGB)
    assert "0.003 rad" in shown_fold._controls.text.content
    shown_fold._controls.colours.value = COLOUR_ALONG_CHAIN
    ramp = instance_colours(ramp_colours(np.linspace(0.0, 1.0, len(chain))))
    assert (colours(shown_fold) == ramp).all()


def test_clicked_module_is_described(shown_fold: Shown) -> None:
    shown_fold.frame = 199
    shown_fold._select(6)
    assert colours(shown_fold)[6].tolist() == linear(SELECTED_RGB)
    panel = shown_fold._controls.module.content
    for text in ("**Module 7** of 16", "joint_6_z: ", f"error {FINAL_ERROR_RAD} rad"):
        assert text in panel
    shown_fold._select(6)  # another click deselects it
    assert shown_fold._controls.module.content == "Click on a module."


def test_playing_stops_at_the_end_and_begins_again(shown_fold: Shown) -> None:
    shown_fold._controls.speed.value = "4×"
    shown_fold.frame = 190
    shown_fold.play()
    assert shown_fold._controls.button.label == "Pause"
    wait_until(lambda: shown_fold._controls.button.label == "Play")
    assert shown_fold.frame == 199
    shown_fold.play()
    wait_until(lambda: 0 < shown_fold.frame < 190)
    shown_fold.pause()
    assert shown_fold._controls.button.label == "Play"


def test_closing_frees_the_port_and_all_threads(timeline_path: Path) -> None:
    before = set(threading.enumerate())
    shown_fold = show(timeline_path, port=0)
    port = shown_fold.server.get_port()
    shown_fold.play()
    shown_fold.close()
    shown_fold.close()
    with socket.socket() as second_socket:
        second_socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        second_socket.bind(("127.0.0.1", port))
    wait_until(lambda: not {t for t in threading.enumerate() if t.is_alive()} - before)


def test_unusable_addresses_and_places_without_a_timeline_are_refused(
    timeline_path: Path, tmp_path: Path
) -> None:
    hosts = [{"host": host} for host in ("192.0.2.1", "no such host", "x" * 300)]
    for address in (*hosts, {"port": 70_000}):
        with refused("no-such-address"):
            show(timeline_path, **{"port": 0, **address})
    with pytest.raises(TimelineError, match="contains no timeline"):
        show(tmp_path, port=0)


def test_notebook_gets_an_escaped_iframe(shown_fold: Shown) -> None:
    assert (
        f'<iframe src="http://127.0.0.1:{shown_fold.server.get_port()}"' in shown_fold._repr_html_()
    )
    shown_fold.url = 'http://x/"><script>alert(1)</script>'
    assert "<script" not in shown_fold._repr_html_()
    assert 'x/">' not in shown_fold._repr_html_()


def test_newest_frame_is_followed_until_another_is_chosen(growing: Growing) -> None:
    path, writer, add = growing
    with show(Timeline.open(path), port=0) as shown_fold:
        assert shown_fold._controls.slider.max == 10
        add(5)
        wait_until(lambda: shown_fold._controls.slider.max == 15)
        assert shown_fold.frame == 0
    with show.live(port=0) as live:
        assert live._controls.text.content == "Nothing to show yet."
        live(Progress(stage="play_back", fraction=0.25, directory=str(path.parent)))
        wait_until(lambda: live.frame == 14)
        wait_until(
            lambda: live._controls.text.content.startswith("Play back, 25%\n\n**Frame 15 of 15**")
        )
        live.frame = 3
        add(5)
        wait_until(lambda: live._playhead.last == 19)
        assert live.frame == 3
        live.frame = 19
        add(5)
        wait_until(lambda: live.frame == 24)
        live.pause()
        writer.close()
        live(Progress(stage="export", fraction=1.0, directory=str(path.parent)))
        wait_until(lambda: live._moments is live._finished_plan)
        live.play()  # the fold is finished: from the first frame
        assert live.frame == 0
        # A report with a directory that has no timeline is ignored.
        live(Progress(stage="export", fraction=1.0, directory=str(path)))


def test_plan_is_posed_as_its_timeline(tmp_path: Path) -> None:
    directory = tmp_path / "folded"
    plan = fold(snake((2, 2, 3)), directory=directory)
    with show(plan, port=0) as shown_plan, show(directory, port=0) as shown_directory:
        first = int(np.argmax(Timeline.open(directory / "timeline").frames().phase))
        assert shown_directory._playhead.last == first + shown_plan._playhead.last
        assert shown_plan._controls.text.content.startswith("**Frame 1 of")
        for frame in (0, shown_plan._playhead.last // 2, shown_plan._playhead.last):
            shown_plan.frame, shown_directory.frame = frame, first + frame
            # The plan has the target angles, the timeline those of a simulated robot.
            assert np.abs(positions(shown_plan) - positions(shown_directory)).max() < 0.01
            assert (colours(shown_plan) == colours(shown_directory)).all()
    # The file of a plan contains no errors for the colours.
    assert np.isfinite(plan.motion.joint_error_rad).any()
    with show(Plan.load(directory / "plan.npz"), port=0) as shown_plan:
        shown_plan.frame = shown_plan._playhead.last
        assert shows_positions(shown_plan)
    with refused("no-frames"):
        show(replace(plan, motion=plan.motion[:0]), port=0)


def test_fold_on_a_table_has_its_table_until_another_is_shown(tmp_path: Path) -> None:
    with show.live(port=0) as live:
        plan = fold(chain_of(SNAKE), world="table", directory=tmp_path, progress=live)
        with show(tmp_path, port=0) as first, show(plan, port=0) as second:
            nodes = [
                shown_fold.server.scene._handle_from_node_name
                for shown_fold in (live, first, second)
            ]
        assert all("/table" in names for names in nodes)
        fold(chain_of(SNAKE), directory=tmp_path, progress=live)
        assert "/table" not in nodes[0]
        with refused("no-directory"):
            fold(chain_of(SNAKE), progress=live)


def test_windows_are_posed_as_their_timeline(peeled: Path) -> None:
    timeline = Timeline.open(peeled / "timeline")
    moments = MotionMoments(timeline.chain, timeline.motion())
    view = TimelineView(peeled / "timeline")
    assert timeline.windowed and len(moments) == len(view)
    assert moments.error_scale_rad == view.error_scale_rad
    for frame in np.linspace(0, len(view) - 1, 7).round():
        snapshot, other_snapshot = moments.snapshot(frame), view.snapshot(frame)
        assert np.allclose(snapshot.positions, other_snapshot.positions, atol=1e-5)
        assert np.allclose(
            snapshot.module_error_rad, other_snapshot.module_error_rad, equal_nan=True
        )
        assert (snapshot.phase, snapshot.framed, snapshot.time_s) == (
            other_snapshot.phase,
            other_snapshot.framed,
            other_snapshot.time_s,
        )
    plan = Workspace(peeled).read_plan()
    moments = MotionMoments(plan.chain, plan.motion)
    for frame in range(-len(moments), 0, 5):
        snapshot, other_snapshot = (
            moments.snapshot(len(moments) + frame),
            view.snapshot(len(view) + frame),
        )
        assert np.array_equal(
            snapshot.module_error_rad, other_snapshot.module_error_rad, equal_nan=True
        )


def test_live_fold_is_followed_and_outlives_its_directory(tmp_path: Path) -> None:
    with show.live(port=0) as live:
        assert isinstance(live, Live)
        reports: list[Progress] = []
        node_ids: set[int] = set()

        def follow_progress(progress: Progress) -> None:
            live(progress)
            reports.append(progress)
            node_ids.add(live._playhead.last)

        plan = fold(snake((2, 2, 3)), directory=tmp_path, progress=follow_progress)
        directory = reports[-1].directory
        assert directory is not None and not Path(directory).exists()
        assert live._controls.text.content.startswith("Done")
        assert live.frame == live._playhead.last > 0
        assert live._playhead.last >= len(plan.motion)
        apart = distances(plan.chain.folded_poses.positions)
        assert np.abs(distances(positions(live)) - apart).max() < 0.01
        live.frame = 0  # the frames are in memory, although the directory is gone
        assert live.frame == 0
        assert np.abs(distances(positions(live)) - apart).max() < 0.2
