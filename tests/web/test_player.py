from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import viser

from planner.chain import Chain
from planner.paths import Path as CellPath
from planner.readers.angle_strings import read_angle_string
from planner.timeline import TimelineWriter
from tests.web.conftest import unfolding
from web.film import Film
from web.player import HOLD_S, SLOWEST_FPS, Player

Growing = tuple[Path, TimelineWriter, Callable[[int], None]]
STEP_S = 1 / 20


class Visit:
    """A player with a clock of its own, and all that it told."""

    def __init__(self, server: viser.ViserServer, path: Path) -> None:
        self.path = path
        self.player = Player(server, self._film)
        self.now = 0.0
        self.told: list[dict[str, Any]] = []
        self.leave = self.player.subscribe(self.told.append)
        self.pass_time(0.0)

    def _film(self) -> Film | None:
        return Film(self.path) if self.path.exists() else None

    def do(self, verb: str, **more: Any) -> dict[str, Any]:
        self.player.handle({"do": verb, **more})
        return self.last("state")

    def pass_time(self, seconds: float) -> dict[str, Any]:
        end = self.now + seconds
        while True:
            self.player.tick(self.now)
            if self.now >= end - 1e-9:
                return self.last("state")
            self.now = min(self.now + STEP_S, end)

    def last(self, kind: str) -> dict[str, Any]:
        return next((m for m in reversed(self.told) if m["is"] == kind), {})


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


@pytest.fixture
def visit(server: viser.ViserServer, timeline_path: Path) -> Visit:
    return Visit(server, timeline_path)


def test_it_begins_still_at_the_first_frame(visit: Visit) -> None:
    state = visit.last("state")
    assert (state["frame"], state["playing"], state["frames"]) == (0.0, False, 200)
    assert visit.last("outline")["modules"] == 16


def test_playing_moves_on_evenly(visit: Visit) -> None:
    visit.do("play")
    first = visit.pass_time(2.0)["frame"]
    second = visit.pass_time(2.0)["frame"]
    assert first == pytest.approx(2 * SLOWEST_FPS, abs=0.01)
    assert second == pytest.approx(2 * first, abs=0.01)
    visit.do("pause")
    assert visit.pass_time(1.0)["frame"] == second


def test_speed_and_reverse(visit: Visit) -> None:
    visit.do("seek", frame=100)
    visit.do("set", speed=2, reverse=True)
    visit.do("play")
    assert visit.pass_time(1.0)["frame"] == pytest.approx(100 - 2 * SLOWEST_FPS, abs=0.01)


def test_it_stops_at_the_end_and_plays_again_from_the_start(visit: Visit) -> None:
    visit.do("seek", percent=99)
    visit.do("play")
    state = visit.pass_time(3.0)
    assert (state["frame"], state["playing"]) == (199.0, False)
    assert visit.do("toggle")["frame"] == 0.0


def test_a_loop_rests_at_the_end_and_starts_over(visit: Visit) -> None:
    visit.do("seek", frame=198)
    visit.do("set", loop=True)
    visit.do("play")
    assert visit.pass_time(0.3)["frame"] == 199.0
    assert 0.0 < visit.pass_time(HOLD_S + 0.5)["frame"] < 20


def test_steps_are_whole_frames_and_stop(visit: Visit) -> None:
    visit.do("seek", frame=10.4)
    assert visit.do("step", by=1)["frame"] == 11
    assert visit.do("step", by=-1)["frame"] == 10
    visit.do("play")
    assert visit.do("step", by=-100)["frame"] == 0
    assert not visit.last("state")["playing"]
    assert visit.do("step", by=1000)["frame"] == 199


def test_a_seek_shows_the_frame_and_its_error(visit: Visit) -> None:
    state = visit.do("seek", frame=199)
    assert (state["phase"], state["error_rad"]) == ("playback", 3e-3)
    assert visit.do("seek", percent=0)["error_rad"] is None


def test_only_cubes_are_told_to_lie_in_cells(server: viser.ViserServer, tmp_path: Path) -> None:
    tetrahedra = read_angle_string("- - - + - - - + - - -")
    path = tmp_path / "timeline.zarr"
    with TimelineWriter.create(path, tetrahedra) as writer:
        writer.append(unfolding(tetrahedra, 4))
    visit = Visit(server, path)
    visit.do("select", module=3)
    module = visit.last("module")
    assert (module["index"], module["cell"]) == (3, None)
    visit.leave()


def test_a_module_is_told_about_and_followed(visit: Visit) -> None:
    visit.do("seek", frame=0)
    visit.do("select", module=6)
    module = visit.last("module")
    assert (module["index"], module["modules"], module["cell"]) == (6, 16, [1, 1, 0])
    assert [j["name"] for j in module["joints"]] == ["joint_6_z", "joint_6_y"]
    visit.do("select", module=3)
    joint = visit.last("module")["joints"][0]
    assert joint["angle_rad"] == pytest.approx(joint["target_rad"])
    assert abs(joint["target_rad"]) == pytest.approx(np.pi / 2, abs=1e-5)
    visit.do("seek", frame=99)
    assert visit.last("module")["joints"][0]["angle_rad"] == 0.0
    visit.do("select", module=None)
    assert visit.last("module")["index"] is None


def test_the_ends_carry_no_joint(visit: Visit) -> None:
    for index in (0, 15):
        visit.do("select", module=index)
        assert visit.last("module")["joints"] == []


@pytest.mark.parametrize(
    "message",
    [
        {},
        {"do": "fly"},
        {"do": "seek"},
        {"do": "seek", "frame": "7"},
        {"do": "seek", "frame": float("nan")},
        {"do": "step", "by": None},
        {"do": "set", "loop": 1},
        {"do": "set", "speed": True},
        {"do": "select", "module": 16},
        {"do": "select", "module": -1},
        {"do": ["seek"]},
    ],
)
def test_nonsense_is_told_and_changes_nothing(visit: Visit, message: dict[str, Any]) -> None:
    before = visit.player.head
    visit.player.handle(message)
    assert visit.last("problem")["detail"].startswith("got ")
    assert visit.player.head == before


def test_without_a_timeline_it_waits_and_then_begins(
    server: viser.ViserServer, tmp_path: Path, timeline_path: Path
) -> None:
    visit = Visit(server, tmp_path / "timeline.zarr")
    assert visit.told == [{"is": "waiting"}]
    visit.do("seek", frame=3)
    visit.path = timeline_path
    assert visit.pass_time(1.0)["frames"] == 200


def test_a_growing_timeline_is_followed_at_its_tail(
    server: viser.ViserServer, growing: Growing
) -> None:
    path, writer, add = growing
    visit = Visit(server, path)
    assert visit.last("state")["live"]
    add(60)
    visit.player._film.refresh(at_once=True)
    early = visit.pass_time(0.2)["frame"]
    assert 9 < early < 60
    assert visit.pass_time(4.0)["frame"] == 69
    visit.do("seek", frame=5)
    add(10)
    visit.player._film.refresh(at_once=True)
    state = visit.pass_time(0.5)
    assert (state["frame"], state["frames"], state["live"]) == (5.0, 80, False)
    visit.do("set", live=True)
    writer.close()
    visit.player._film.refresh(at_once=True)
    state = visit.pass_time(4.0)
    assert (state["frame"], state["live"], state["growing"]) == (79, False, False)


def test_a_timeline_that_is_begun_anew_is_found_anew(
    server: viser.ViserServer, growing: Growing
) -> None:
    path, writer, add = growing
    add(60)
    visit = Visit(server, path)
    visit.do("seek", frame=40)
    visit.do("select", module=5)
    other = Chain.from_path(CellPath.from_cells([(x, 0, 0) for x in range(9)], name="rod"))
    again = TimelineWriter.create(path, other)  # as the next candidate of a fold does
    visit.player._film.refresh(at_once=True)
    visit.pass_time(0.5)
    assert visit.told[-1] == {"is": "waiting"}
    assert visit.last("module")["index"] is None
    for message in ({"do": "seek", "frame": 3}, {"do": "play"}, {"do": "select", "module": 1}):
        visit.player.handle(message)
    assert visit.last("problem") == {}
    again.append(unfolding(other, 12))
    again.close()
    state = visit.pass_time(1.0)
    assert (state["frames"], visit.last("outline")["modules"]) == (12, 9)
    assert visit.do("seek", frame=11)["frame"] == 11
    assert len(visit.player.snapshot.positions) == 9


def test_a_timeline_that_is_begun_anew_and_has_grown_is_found_anew(
    server: viser.ViserServer, growing: Growing
) -> None:
    path, writer, add = growing
    visit = Visit(server, path)
    other = Chain.from_path(CellPath.from_cells([(x, 0, 0) for x in range(9)], name="rod"))
    again = TimelineWriter.create(path, other)
    again.append(unfolding(other, 30))
    again.flush()
    visit.player._film.refresh(at_once=True)
    visit.pass_time(1.0)
    assert (visit.last("state")["frames"], visit.last("outline")["modules"]) == (30, 9)
    assert len(visit.player.snapshot.positions) == 9


def test_a_whole_timeline_that_is_begun_anew_is_found_anew(
    server: viser.ViserServer, growing: Growing
) -> None:
    path, writer, add = growing
    writer.close("failed")
    visit = Visit(server, path)
    assert not visit.player.busy
    other = Chain.from_path(CellPath.from_cells([(x, 0, 0) for x in range(9)], name="rod"))
    again = TimelineWriter.create(path, other)
    again.append(unfolding(other, 30))
    again.flush()
    visit.player._film._refreshed = -1e9  # as if some time had passed
    visit.pass_time(1.0)
    assert (visit.last("state")["frames"], visit.last("outline")["modules"]) == (30, 9)


def test_who_has_left_is_told_nothing_more(visit: Visit) -> None:
    visit.leave()
    count = len(visit.told)
    visit.player.handle({"do": "seek", "frame": 7})
    assert len(visit.told) == count
