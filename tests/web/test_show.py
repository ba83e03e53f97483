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
    UNKNOWN_ERROR_RGB,
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
def shown(timeline_path: Path) -> Iterator[Shown]:
    with show(timeline_path, port=0) as shown:
        yield shown


def colours(shown: Shown) -> np.ndarray:
    """Return the (n, 3) linear bytes that clients were sent."""
    return np.asarray(shown._scene._modules.batched_colors)


def positions(shown: Shown) -> np.ndarray:
    return np.asarray(shown._scene._modules.batched_positions) / shown._scene.pitch


def distances(positions: np.ndarray) -> np.ndarray:
    """Return the (n, n) distances between all modules, since the chain floats."""
    return np.linalg.norm(positions[:, None] - positions[None], axis=-1)


def linear(rgb: tuple[int, int, int]) -> list[int]:
    return instance_colours(np.array([rgb], np.uint8))[0].tolist()


def test_frames_are_posed_as_in_the_timeline(shown: Shown, timeline_path: Path) -> None:
    assert type(shown.server) is viser.ViserServer
    assert shown.url == f"http://127.0.0.1:{shown.server.get_port()}"
    view = TimelineView(timeline_path)
    for frame in (0, 40, 199):
        shown.frame = frame
        assert np.allclose(positions(shown), view.snapshot(frame).positions, atol=1e-6)
        assert shown._controls.slider.value == frame + 1  # counted from 1
        assert f"Frame {frame + 1} of 200" in shown._controls.text.content
    for asked, got in ((-5, 0), (10**12, 199)):
        shown.frame = asked
        assert shown.frame == shown._controls.slider.value - 1 == got


def test_colours_show_joint_errors_or_the_place_in_the_chain(shown: Shown, chain: Chain) -> None:
    shown.frame = 50
    assert (colours(shown) == linear(UNKNOWN_ERROR_RGB)).all()  # no errors during the explosion
    assert "The joint error was not recorded" in shown._controls.text.content
    shown.frame = 199
    red = instance_colours(error_colours(np.array([FINAL_ERROR_RAD]), 5e-3))[0]
    assert colours(shown)[6].tolist() == red.tolist()
    assert colours(shown)[4].tolist() == linear(NO_ERROR_RGB)
    assert "0.003 rad" in shown._controls.text.content
    shown._controls.colours.value = COLOUR_ALONG_CHAIN
    ramp = instance_colours(ramp_colours(np.linspace(0.0, 1.0, len(chain))))
    assert (colours(shown) == ramp).all()


def test_clicked_module_is_described(shown: Shown) -> None:
    shown.frame = 199
    shown._select(6)
    assert colours(shown)[6].tolist() == linear(SELECTED_RGB)
    panel = shown._controls.module.content
    for text in ("**Module 7** of 16", "joint_6_z: ", f"error {FINAL_ERROR_RAD} rad"):
        assert text in panel
    shown._select(6)  # another click deselects it
    assert shown._controls.module.content == "Click on a module."


def test_playing_stops_at_the_end_and_begins_again(shown: Shown) -> None:
    shown._controls.speed.value = "4×"
    shown.frame = 190
    shown.play()
    assert shown._controls.button.label == "Pause"
    wait_until(lambda: shown._controls.button.label == "Play")
    assert shown.frame == 199
    shown.play()
    wait_until(lambda: 0 < shown.frame < 190)
    shown.pause()
    assert shown._controls.button.label == "Play"


def test_closing_frees_the_port_and_all_threads(timeline_path: Path) -> None:
    before = set(threading.enumerate())
    shown = show(timeline_path, port=0)
    port = shown.server.get_port()
    shown.play()
    shown.close()
    shown.close()
    with socket.socket() as again:
        again.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        again.bind(("127.0.0.1", port))
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


def test_notebook_gets_an_escaped_iframe(shown: Shown) -> None:
    assert f'<iframe src="http://127.0.0.1:{shown.server.get_port()}"' in shown._repr_html_()
    shown.url = 'http://x/"><script>alert(1)</script>'
    assert "<script" not in shown._repr_html_()
    assert 'x/">' not in shown._repr_html_()


def test_newest_frame_is_followed_until_another_is_chosen(growing: Growing) -> None:
    path, writer, add = growing
    with show(Timeline.open(path), port=0) as shown:
        assert shown._controls.slider.max == 10
        add(5)
        wait_until(lambda: shown._controls.slider.max == 15)
        assert shown.frame == 0
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
        wait_until(lambda: live._moments is live._whole)
        live.play()  # the fold is finished: from the first frame
        assert live.frame == 0
        # A report with a directory that has no timeline is ignored.
        live(Progress(stage="export", fraction=1.0, directory=str(path)))


def test_plan_is_posed_as_its_timeline(tmp_path: Path) -> None:
    directory = tmp_path / "folded"
    plan = fold(snake((2, 2, 3)), directory=directory)
    with show(plan, port=0) as shown, show(directory, port=0) as whole:
        first = int(np.argmax(Timeline.open(directory / "timeline.zarr").frames().phase))
        assert whole._playhead.last == first + shown._playhead.last
        assert shown._controls.text.content.startswith("**Frame 1 of")
        for frame in (0, shown._playhead.last // 2, shown._playhead.last):
            shown.frame, whole.frame = frame, first + frame
            # The plan has the target angles, the timeline those of a simulated robot.
            assert np.abs(positions(shown) - positions(whole)).max() < 0.01
            assert (colours(shown) == colours(whole)).all()
    # The file of a plan contains no errors for the colours.
    assert np.isfinite(plan.motion.joint_error_rad).any()
    with show(Plan.load(directory / "plan.npz"), port=0) as shown:
        shown.frame = shown._playhead.last
        assert (colours(shown) == linear(UNKNOWN_ERROR_RGB)).all()
    with refused("no-frames"):
        show(replace(plan, motion=plan.motion[:0]), port=0)


def test_fold_on_a_table_has_its_table_until_another_is_shown(tmp_path: Path) -> None:
    with show.live(port=0) as live:
        plan = fold(chain_of(SNAKE), world="table", directory=tmp_path, progress=live)
        with show(tmp_path, port=0) as one, show(plan, port=0) as other:
            nodes = [each.server.scene._handle_from_node_name for each in (live, one, other)]
        assert all("/table" in names for names in nodes)
        fold(chain_of(SNAKE), directory=tmp_path, progress=live)
        assert "/table" not in nodes[0]
        with refused("no-directory"):
            fold(chain_of(SNAKE), progress=live)


def test_windows_are_posed_as_their_timeline(peeled: Path) -> None:
    timeline = Timeline.open(peeled / "timeline.zarr")
    moments = MotionMoments(timeline.chain, timeline.motion())
    view = TimelineView(peeled / "timeline.zarr")
    assert timeline.windowed and len(moments) == len(view)
    assert moments.error_scale_rad == view.error_scale_rad
    for frame in np.linspace(0, len(view) - 1, 7).round():
        one, other = moments.snapshot(frame), view.snapshot(frame)
        assert np.allclose(one.positions, other.positions, atol=1e-5)
        assert np.allclose(one.module_error_rad, other.module_error_rad, equal_nan=True)
        assert (one.phase, one.framed, one.time_s) == (other.phase, other.framed, other.time_s)
    plan = Workspace(peeled).read_plan()
    moments = MotionMoments(plan.chain, plan.motion)
    for frame in range(-len(moments), 0, 5):
        one, other = moments.snapshot(len(moments) + frame), view.snapshot(len(view) + frame)
        assert np.array_equal(one.module_error_rad, other.module_error_rad, equal_nan=True)


def test_live_fold_is_followed_and_outlives_its_directory(tmp_path: Path) -> None:
    with show.live(port=0) as live:
        assert isinstance(live, Live)
        reports: list[Progress] = []
        seen: set[int] = set()

        def follow_progress(progress: Progress) -> None:
            live(progress)
            reports.append(progress)
            seen.add(live._playhead.last)

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
