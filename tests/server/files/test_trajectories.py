"""Trajectories: computed once for equal requests, limited in bytes, shared while in use."""

import asyncio
import json
import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, BinaryIO, cast
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np
import pytest

from foldback.planner.pipeline.packed_fold import unpack
from foldback.planner.plan.plan import Plan
from foldback.planner.trajectories.retiming import retime as retime_plan
from foldback.planner.trajectories.trajectory import FRAMES_FILE, REST_FILE
from foldback.server.errors import TooLarge, TooMany, Unavailable, Unusable
from foldback.server.files.trajectories import (
    MOTORS_FILE,
    PLAN,
    STREAMS_OF_ADDRESS,
    MotorsRequest,
    Retimed,
    Trajectories,
    TrajectoryRequest,
)
from foldback.server.processes.children import Pool
from foldback.server.processes.retime_task import clearance, motors, retime
from foldback.server.settings import Settings
from tests.server.files.test_damage import SMALL


class TasksInProcess:
    """Replacement of a child that runs its tasks in this process and counts them."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        self.go_on = threading.Event()
        self.go_on.set()

    def call(self, task: str, place: Path) -> dict[str, Any]:
        self.calls.append(task)
        assert self.go_on.wait(30.0)
        return {"retime": retime, "clearance": clearance, "motors": motors}[task](place)

    def close(self) -> None:
        pass


class Motions:
    """Trajectories of a plan, computed in this process."""

    def __init__(self, place: Path, plan: Path) -> None:
        self.place, self.plan, self.tasks = place, plan, TasksInProcess()

    def trajectories(self, **extra: int) -> Trajectories:
        """Return an empty cache of trajectories within bounds."""
        return Trajectories(Settings(data_dir=self.place), cast("Pool", self.tasks), **extra)

    def wanted(self, speed: float = 1.0) -> TrajectoryRequest:
        return TrajectoryRequest.of(self.plan, speed, 2.0)

    def retime(self, **bounds: int) -> Retimed:
        """Return the motion as the service computes it."""
        return asyncio.run(self.trajectories(**bounds).of(self.wanted(), "a"))


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Path of the plan of a small fold."""
    directory = tmp_path_factory.mktemp("fold")
    unpack(SMALL.read_bytes(), directory)
    return directory / "plan.npz"


@pytest.fixture
def motions(tmp_path: Path, plan: Path) -> Motions:
    return Motions(tmp_path, plan)


def test_trajectory_is_that_of_the_planner_and_leaves_no_files(motions: Motions) -> None:
    retimed = motions.retime()
    meant = retime_plan(Plan.load(motions.plan), 1.0, 2.0)
    times = np.linspace(0.0, meant.duration_s, 101)
    for first, second in zip(retimed.trajectory.at(times), meant.at(times), strict=True):
        assert np.array_equal(first, second)
    assert np.array_equal(retimed.trajectory.frame_at(times), meant.frame_at(times))
    assert retimed.trajectory.joint_names == meant.joint_names
    assert retimed.trajectory.deviation_rad == meant.deviation_rad
    assert retimed.verified
    assert [*(motions.place / "scratch").iterdir(), *(motions.place / "motions").iterdir()] == []


def test_hijacked_child_changes_no_plan_and_no_trajectory(
    motions: Motions, monkeypatch: pytest.MonkeyPatch
) -> None:
    before, call = motions.plan.read_bytes(), motions.tasks.call
    binary_ios: list[BinaryIO] = []

    def hijacked(task: str, place: Path) -> dict[str, Any]:
        answer = call(task, place)
        (place / PLAN).write_bytes(b"other")
        binary_ios.append((place / FRAMES_FILE).open("r+b"))
        return answer

    monkeypatch.setattr(motions.tasks, "call", hijacked)
    retimed = motions.retime()
    now = motions.plan.read_bytes()
    motions.plan.write_bytes(before)
    assert now == before
    with binary_ios[0] as frames:
        frames.write(bytes(1 << 16))
    corners = retimed.trajectory.path.frames
    assert np.array_equal(corners, retime_plan(Plan.load(motions.plan), 1.0, 2.0).path.frames)


def test_files_of_the_child_are_read_within_bounds(
    motions: Motions, monkeypatch: pytest.MonkeyPatch
) -> None:
    call, spoiled = motions.tasks.call, Path()

    def hijacked(task: str, place: Path) -> dict[str, Any]:
        answer = call(task, place)
        if str(spoiled) == REST_FILE and not bounds:
            (place / REST_FILE).write_bytes(b"rubbish")
        elif str(spoiled) == REST_FILE:
            with ZipFile(place / REST_FILE, "a", ZIP_DEFLATED) as parts:
                parts.writestr("bomb.npy", bytes(2**25))
        else:
            os.truncate(place / spoiled, 2**32)
        return answer

    monkeypatch.setattr(motions.tasks, "call", hijacked)
    expected = motions.wanted()
    for name, bounds, kind in (
        (FRAMES_FILE, {"used_bytes": 2**24}, TooLarge),
        (REST_FILE, {"used_bytes": 2**24}, TooLarge),
        (REST_FILE, {}, Unavailable),
    ):
        spoiled = Path(name)
        with pytest.raises(kind):
            motions.retime(**bounds)
    spoiled = Path(MOTORS_FILE)
    robot = MotorsRequest(
        module_mass_kg=0.1,
        pitch_m=None,
        gravity_m_s2=9.81,
        held=True,
        motor_torque_nm=None,
        form="csv",
    )
    with pytest.raises(TooLarge):
        asyncio.run(motions.trajectories().motors(expected, robot, "a"))


def test_trajectories_sent_to_one_address_are_limited(motions: Motions) -> None:
    trajectories = motions.trajectories()
    places = [trajectories.stream("a") for _ in range(STREAMS_OF_ADDRESS)]
    with pytest.raises(TooMany) as refused:
        trajectories.stream("a")
    assert refused.value.code == "too-many-motions"
    trajectories.stream("b").leave()
    places[0].leave()
    trajectories.stream("a").leave()


def test_equal_requests_share_one_trajectory_without_threads(motions: Motions) -> None:
    async def ask() -> None:
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(1))
        trajectories = motions.trajectories()
        motions.tasks.go_on.clear()
        expected = [motions.wanted(speed) for speed in (1.0, 2.0, 3.0, 4.0, 5.0)]
        same_tasks = [asyncio.create_task(trajectories.of(expected[0], f"v{k}")) for k in range(24)]
        other_tasks = [asyncio.create_task(trajectories.of(w, "v0")) for w in expected[1:4]]
        await asyncio.sleep(0)
        assert await asyncio.wait_for(asyncio.to_thread(lambda: "free"), 10.0) == "free"
        with pytest.raises(TooMany):
            await trajectories.of(expected[4], "v0")
        motions.tasks.go_on.set()
        assert len({id(trajectory) for trajectory in await asyncio.gather(*same_tasks)}) == 1
        await asyncio.gather(*other_tasks)
        assert motions.tasks.calls == ["retime"] * 4
        trajectories.close()

    asyncio.run(ask())


def test_cached_trajectories_are_bounded_by_bytes_and_share_frames(motions: Motions) -> None:
    async def ask() -> None:
        trajectory = (await motions.trajectories().of(motions.wanted(), "a")).trajectory
        trajectories = motions.trajectories(kept_bytes=3 * trajectory.nbytes)
        for k in range(20):
            await trajectories.of(motions.wanted(1.0 + k), "a")
            assert trajectories.nbytes <= 3 * trajectory.nbytes
        before = len(motions.tasks.calls)
        await trajectories.of(motions.wanted(20.0), "a")
        assert len(motions.tasks.calls) == before  # the last one is still cached
        await trajectories.of(motions.wanted(), "a")
        assert len(motions.tasks.calls) == before + 1  # the first one is not
        used = [await trajectories.of(motions.wanted(50.0 + k), "a") for k in range(8)]
        assert len({id(trajectory_use.trajectory.path.frames) for trajectory_use in used}) == 1
        assert trajectories.nbytes < 4 * trajectory.nbytes + 8 * (
            trajectory.nbytes - trajectory.path.frames.nbytes
        )

    asyncio.run(ask())


def test_trajectories_in_use_are_bounded(motions: Motions) -> None:
    async def ask() -> None:
        trajectory = (await motions.trajectories().of(motions.wanted(), "a")).trajectory
        trajectories = motions.trajectories(used_bytes=int(1.5 * trajectory.nbytes), kept_bytes=0)
        kept_trajectories = [await trajectories.of(motions.wanted(), "a")]
        with pytest.raises(Unavailable) as refused:
            for k in range(10):
                kept_trajectories.append(await trajectories.of(motions.wanted(2.0 + k), "a"))
        assert refused.value.code == "busy"
        kept_trajectories.clear()
        del refused  # its traceback refers to the refused one
        await trajectories.of(motions.wanted(30.0), "a")

    asyncio.run(ask())


def test_rate_at_which_modules_overlap_is_refused_with_advice(
    motions: Motions, monkeypatch: pytest.MonkeyPatch
) -> None:
    for enough, advice in ((4.0, "use rate=4"), (None, "request a higher rate")):

        def refuse_overlap(task: str, place: Path, enough: float | None = enough) -> dict[str, Any]:
            assert json.loads((place / "request.json").read_bytes())["rate_hz"] == 1.0
            clearance_values = {"min_clearance": -0.36, "clearance_bound": -0.36, "overlap": True}
            return {**clearance_values, "sufficient_rate_hz": enough}

        monkeypatch.setattr(motions.tasks, "call", refuse_overlap)
        with pytest.raises(Unusable, match=advice):
            asyncio.run(motions.trajectories().clearance(motions.wanted(), 1.0, "visitor"))
