"""Robot API: trajectories, torques and motions in real time."""

import contextlib
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
import pytest
from websockets import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from foldback.planner.plan.plan import Plan
from foldback.planner.reasons import Reason, ReasonCode
from foldback.server.settings import Settings
from foldback.server.store.folds import new_id
from tests.case import case
from tests.server.cli.test_command_line import foldback, foldback_json
from tests.server.rows import SOMEBODY, a_fold, store_of
from tests.server.service_process import FinishedFold, Service, check_problem, wait_until

EXAMPLE = Path(__file__).parents[3] / "examples" / "06_drive_a_robot.py"
LIMITS = {"max_speed": 0.5, "max_acceleration": 1.0}
LIMIT_OPTIONS = ("--max-speed", "0.5", "--max-acceleration", "1")
"""Options for the same limits on the command line."""


class Client:
    """Client at the other end of a socket."""

    def __init__(self, socket: ClientConnection) -> None:
        self.socket = socket
        self.last: dict[str, Any] = {}

    def receive(self) -> dict[str, Any]:
        message = json.loads(self.socket.recv(timeout=30))
        if message["is"] in ("begin", "target"):
            self.last = {"number": 0, "time_s": 0.0, **message}
        return message

    def receive_until(self, expected: str) -> dict[str, Any]:
        """Receive messages, without an answer, until one of the given kind arrives."""
        while (message := self.receive())["is"] != expected:
            pass
        return message

    def send(self, do: str, **extra: object) -> None:
        self.socket.send(json.dumps({"do": do, **extra}))

    def report(self, **error: object) -> None:
        """Report an error, or angles, for the last target."""
        self.send("report", number=self.last["number"], **error)

    def follow_until(self, expected: str) -> dict[str, Any]:
        """Follow all targets until a message of the given kind arrives."""
        while (message := self.receive())["is"] != expected:
            if message["is"] in ("begin", "target"):
                self.report(error_rad=0.0)
        return message


def address(service: Service, fold_id: str, **options: object) -> str:
    return f"ws://{service.netloc}/api/folds/{fold_id}/play?{urlencode(options)}"


@contextlib.contextmanager
def playing(service: Service, fold_id: str, **options: object) -> Iterator[Client]:
    """Play a fold; on a busy machine, the service releases robots of earlier tests late."""
    sockets: list[ClientConnection] = []
    url = address(service, fold_id, **options)
    wait_until(lambda: sockets.append(connect(url, max_size=None)) or True, errors=(InvalidStatus,))
    with sockets[0] as socket:
        yield Client(socket)


def denial(url: str) -> tuple[str, int]:
    """Return the code and the HTTP status with which a handshake is refused."""
    with pytest.raises(InvalidStatus) as refused:
        connect(url)
    response = refused.value.response
    assert response.headers["Content-Type"] == "application/problem+json"
    return json.loads(response.body)["code"], response.status_code


def refusal(client: Client) -> tuple[str, int]:
    """Return the reason and the code with which a socket is closed."""
    message = client.receive()
    assert message["is"] == "problem", message
    with pytest.raises(ConnectionClosed) as shut:
        client.receive()
    return message["code"], shut.value.rcvd.code


def test_client_that_follows_is_led_to_the_folded_shape(finished: FinishedFold) -> None:
    plan = finished.http.get(f"{finished.api}/plan.json").json()
    with playing(finished.service, finished.id, speed=20, speeds=True) as client:
        start = client.receive()
        assert (start["is"], start["schema"]) == ("begin", "foldback-play/1")
        assert start["joint_names"] == plan["joint_names"]
        assert start["frames"] == len(plan["time_s"])
        assert start["joint_angles_rad"] == pytest.approx(plan["joint_angles_rad"][0], abs=1e-5)
        assert client.receive()["because"] == "start"
        client.send("report", error_rad=0.0)
        times = [0.0]
        while (message := client.receive())["is"] != "end":
            if message["is"] == "target":
                times.append(message["time_s"])
                assert len(message["joint_speeds_rad_s"]) == len(start["joint_names"])
                client.report(error_rad=0.01)
        assert message["because"] == "folded"
        assert times == sorted(times)
        assert times[-1] == pytest.approx(start["duration_s"], abs=1e-5)
        folded = pytest.approx(plan["joint_angles_rad"][-1], abs=1e-5)
        assert client.last["joint_angles_rad"] == folded


def test_first_target_waits_for_the_client_to_be_at_the_start(finished: FinishedFold) -> None:
    with playing(finished.service, finished.id, rate_hz=100, speed=0.1) as client:
        angles = client.receive()["joint_angles_rad"]
        assert client.receive()["because"] == "start"
        client.send("report", joint_angles_rad=[angle + 1.5 for angle in angles])
        waiting = client.receive()
        assert (waiting["because"], waiting["error_rad"]) == ("error", pytest.approx(1.5))
        with pytest.raises(TimeoutError):
            client.socket.recv(timeout=0.3)  # for thirty ticks
        client.send("report", joint_angles_rad=angles)
        assert client.receive()["is"] == "going"
        target = client.receive()
        assert (target["is"], target["number"]) == ("target", 1)
        assert target["joint_angles_rad"] == pytest.approx(angles, abs=1e-3)
        # Errors are computed from measured angles during the motion, too.
        client.report(joint_angles_rad=[angles[0] + 0.4, *angles[1:]])
        message = client.receive_until("waiting")
        assert (message["because"], message["error_rad"]) == ("error", pytest.approx(0.4, abs=0.02))


def test_play_waits_for_a_slow_client_and_is_paused_and_stopped(finished: FinishedFold) -> None:
    """test_stream_clock.py tests clients in error or without reports."""
    with playing(finished.service, finished.id, speed=0.1, silence_s=30) as client:
        client.follow_until("going")
        answered = client.last["number"]
        assert client.receive_until("waiting")["because"] == "behind"
        assert client.last["number"] - answered < 20
        client.report(error_rad=0.0)
        client.follow_until("going")
        client.send("pause")
        assert client.follow_until("waiting")["because"] == "pause"
        client.send("resume")
        client.follow_until("going")
        client.send("stop")
        assert client.follow_until("end")["because"] == "stop"


def test_bad_messages_are_refused_and_start_nothing(finished: FinishedFold) -> None:
    for text in (
        "no JSON",
        *("[]", '{"do": "fly"}', '{"do": "report"}'),
        *(f'{{"do": "report", "error_rad": {error}}}' for error in ("-1", "NaN")),
        '{"do": "report", "joint_angles_rad": [0, 1]}',
        '{"do": "report", "error_rad": 0, "joint_angles_rad": []}',
    ):
        with case(text), playing(finished.service, finished.id) as client:
            client.socket.send(text)
            while (message := client.receive())["is"] != "problem":
                assert message["is"] != "going"
            assert message["code"] == "bad-message"


def test_bad_options_of_play_are_refused(finished: FinishedFold) -> None:
    for wrong in ("speed=0", "speed=fast", "threshold_rad=9", "rate_hz=1e9", "sped=1"):
        assert denial(address(finished.service, finished.id) + wrong) == ("bad-request", 422), wrong


def test_only_finished_and_verified_folds_are_played(finished: FinishedFold) -> None:
    """tests/server/http/test_security.py asks for a fold that is not ready."""
    service, doubtful = finished.service, new_id()
    assert denial(address(service, "no-such-fold")) == ("no-such-fold", 404)
    with store_of(service) as store:
        store.add(a_fold(doubtful), SOMEBODY)
    path = shutil.copytree(finished.directory, service.directory(doubtful)) / "plan.npz"
    plan = Plan.load(path)
    failed = replace(plan.certificate, reason=Reason.of(ReasonCode.PLAN_END))
    replace(plan, certificate=failed).save_npz(path)
    path.with_name("manifest.json").unlink()  # otherwise the plan would count as damaged
    with playing(service, doubtful) as client:
        assert refusal(client) == ("not-verified", 1008)


def test_number_of_target_streams_of_a_visitor_is_limited(finished: FinishedFold) -> None:
    with ExitStack() as streams:
        for _ in range(Settings().max_target_streams_of_visitor):
            streams.enter_context(playing(finished.service, finished.id))
        assert denial(address(finished.service, finished.id)) == ("too-many-target-streams", 429)


def test_messages_are_bounded_in_size_and_rate(finished: FinishedFold) -> None:
    with playing(finished.service, finished.id) as client:
        client.send("report", error_rad=0.0, nonsense="x" * 100_000)
        assert client.receive_until("problem")["code"] == "too-large"
    with playing(finished.service, finished.id, speed=0.01) as client:
        with contextlib.suppress(ConnectionClosed):  # it may be closed at once
            for _ in range(1200):  # within the same second, or the next
                client.send("resume")
        assert client.receive_until("problem")["code"] == "too-fast"


def test_messages_of_play_have_a_schema(finished: FinishedFold) -> None:
    schema = finished.http.get("/api/play-schema").json()
    assert {"PlayOptions", "Begin", "Target", "Waiting", "Running", "Report", "End"} <= set(
        schema["$defs"]
    )


def test_trajectory_is_given_as_json_and_csv(finished: FinishedFold) -> None:
    path = f"{finished.api}/trajectory"
    document = finished.http.get(path, params=LIMITS).json()
    assert document["plan_verified"] is True
    assert 0.0 < document["clearance_bound"] <= document["min_clearance"]
    assert np.abs(document["joint_speeds_rad_s"]).max() <= 0.5 + 1e-6
    table = finished.http.get(path, params={**LIMITS, "format": "csv", "rate": 20})
    assert table.headers["content-type"].startswith("text/csv")
    rows = [line.split(",") for line in table.text.splitlines()]
    assert len(rows[0]) == 1 + 2 * len(document["joint_names"])
    assert float(rows[-1][0]) == pytest.approx(document["duration_s"], abs=1e-6)
    slow = {"max_speed": 1e-3, "rate": 1e4}
    for wrong, status in (({"max_speed": 0}, 422), ({"format": "xml"}, 422), (slow, 413)):
        assert finished.http.get(path, params=wrong).status_code == status


def test_motors_are_judged_by_their_torque(finished: FinishedFold) -> None:
    path = f"{finished.api}/motors"
    query = {"module_mass": 0.1, "pitch": 0.05, "motor_torque": 0.01}
    weak = finished.http.get(path, params=query).json()
    assert weak["would_do"] is False
    assert weak["verdict"].startswith("No, a motor torque of 0.01 N·m is not enough for ")
    assert finished.http.get(path, params={**query, "motor_torque": 100}).json()["would_do"] is True
    table = finished.http.get(path, params={**query, "format": "csv"}).text.splitlines()
    assert len(table) == 1 + len(weak["joints"])
    check_problem(finished.http.get(path, params={**query, "floating": True}), 422, "bad-build")
    assert finished.http.get(path).status_code == 422


def test_retime_on_the_command_line_gives_the_same_as_the_api(
    finished: FinishedFold, tmp_path: Path
) -> None:
    out, table = tmp_path / "robot.json", tmp_path / "motors.csv"
    command = ("retime", finished.directory, *LIMIT_OPTIONS, "--out", out, "--table", table)
    torques = ("--module-mass", "0.1", "--pitch", "0.05", "--motor-torque", "0.01")
    report = foldback_json(*command, *torques, status=3)
    path = finished.api
    assert report["plan_verified"] is True
    trajectory = finished.http.get(f"{path}/trajectory", params=LIMITS).json()
    assert json.loads(out.read_text()) == trajectory
    query = {**LIMITS, "module_mass": 0.1, "pitch": 0.05, "motor_torque": 0.01}
    assert report["motors"] == finished.http.get(f"{path}/motors", params=query).json()
    assert len(table.read_text().splitlines()) == 1 + len(report["motors"]["joints"])


def test_retimed_plan_without_proved_clearance_exits_with_3(
    finished: FinishedFold, tmp_path: Path
) -> None:
    plan = Plan.load(finished.directory / "plan.npz")
    # Modules of full size touch: they do not overlap, but no clearance can be proved.
    full = replace(plan.certificate, module_size=1.0)
    replace(plan, certificate=full).save_npz(tmp_path / "plan.npz")
    out = str(tmp_path / "robot.csv")
    command = ["retime", str(tmp_path), *LIMIT_OPTIONS]
    done = foldback(*command, "--out", out)
    assert "clearance not proved" in " ".join(done.stdout.split())
    assert done.returncode == 3
    assert foldback(*command, "--out", out, "--no-check").returncode == 0


def test_example_06_drives_a_simulated_robot(finished: FinishedFold) -> None:
    options = ("--url", f"http://{finished.service.netloc}", "--fold", finished.id)
    command = [sys.executable, "-W", "error", str(EXAMPLE), *options]
    command += ["--speed", "5", "--stiffness", "0.02"]
    extra: dict[str, Any] = {"capture_output": True, "text": True, "timeout": 120, "check": False}
    done = subprocess.run(command, env={"PATH": ""}, **extra)
    assert done.returncode == 0, done.stderr
    assert "'because': 'folded'" in done.stdout.splitlines()[-1]
    assert "'because': 'error'" in done.stdout  # weak servos lag behind
