"""Executors of sweeps: Dask on this machine, whose cases end when nobody waits for them."""

from pathlib import Path

import psutil
import pytest
from distributed import Client, LocalCluster, default_client
from distributed.comm import CommClosedError

from foldback.planner.sweeps.case import Case
from foldback.planner.sweeps.executors import DaskExecutor, Place, executor_on, is_public
from foldback.planner.sweeps.limited_process import run_limited
from foldback.planner.sweeps.run import run_cases
from tests.case import case
from tests.planner.sweeps import tasks
from tests.refusal import refused
from tests.server.service_process import wait_until


def test_killed_worker_is_replaced_and_an_unwanted_case_ends(tmp_path: Path) -> None:
    witness = tmp_path / "starts"

    def started() -> list[int]:
        return [int(pid) for pid in witness.read_text().split()] if witness.exists() else []

    with executor_on(Place(workers=1)) as executor:
        killed = Case(key="1", columns={}, task=tasks.KillAncestorOnce(witness, 2))
        (row,) = run_cases([killed], [].append, executor, at_once=executor.at_once)
        assert row["verdict"] == "computed"
        assert len(started()) == 2

        hanging = Case(key="2", columns={}, task=tasks.NoteAndHang(witness))
        future = executor.submit(run_limited, hanging)
        wait_until(lambda: len(started()) == 3)
        future.cancel()
        wait_until(lambda: not psutil.pid_exists(started()[-1]))


def test_place_that_is_not_there_is_refused(tmp_path: Path) -> None:
    files = {"broken.json": "nonsense", "empty.json": "{}", "number.json": '{"address": 3}'}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    for on in (
        *("schedule.json", *(str(tmp_path / name) for name in files)),
        *("head:8786", "http://head:8786", "tcp://head:port", "tcp://[::1", f"tcp://{'a' * 80}"),
    ):
        with case(on), refused("no-scheduler", match="dask scheduler"), executor_on(Place(on=on)):
            pass


def test_certificates_are_asked_for_and_public_addresses_found() -> None:
    with refused("no-scheduler", match="TLS"), executor_on(Place(on="tls://127.0.0.1:9")):
        pass
    assert is_public("tcp://8.8.8.8:8786")
    assert is_public("tcp://[2001:4860:4860::8888]:8786")
    assert is_public("ws://8.8.8.8:8786")
    for on in ("tls://8.8.8.8:8786", "tcp://10.0.0.5:8786", "tcp://127.0.0.1:9", "tcp://[::1]:9"):
        assert not is_public(on)


def test_cluster_on_this_machine_refuses_its_other_users() -> None:
    with executor_on(Place(workers=1)):
        address = default_client().scheduler.address
        assert address.startswith("tls://")
        with pytest.raises(OSError):
            Client(address.replace("tls://", "tcp://"), timeout="2 s")


def test_answer_that_cannot_be_read_here_is_an_error() -> None:
    with (
        LocalCluster(
            1, 1, processes=False, protocol="tcp", dashboard_address="127.0.0.1:0"
        ) as cluster,
        Client(cluster) as client,
    ):
        future = DaskExecutor(client).submit(tasks.answer_of_another_version)
        assert isinstance(future.exception(timeout=30), ImportError)


def test_case_whose_result_a_dead_scheduler_keeps_is_computed_again(tmp_path: Path) -> None:
    witness = tmp_path / "starts"
    with (
        LocalCluster(1, 1, processes=False, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
    ):
        fetch = client.scheduler.gather

        async def fetch_later(**keys: object) -> object:
            client.scheduler.gather = fetch
            raise CommClosedError("the scheduler has ended")

        client.scheduler.gather = fetch_later
        noted = Case(key="1", columns={}, task=tasks.Note(witness))
        rows = list(run_cases([noted], [].append, DaskExecutor(client), at_once=1))
        assert [row["verdict"] for row in rows] == ["noted"]
        assert len(witness.read_text().splitlines()) == 2
