"""Live classes: followers see the view of a leader, and receive nothing else."""

import json
import socket
from contextlib import suppress

import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect
from websockets.sync.connection import Connection

from foldback.server.errors import NoSuch, TooMany
from foldback.server.live_class.class_connections import MAX_VIEWS_PER_SECOND
from foldback.server.live_class.live_classes import CODE_LENGTH, MAX_FOLLOWERS, LiveClasses, is_view
from foldback.server.settings import Settings
from tests.server.service_process import SNAKE, Service

VIEW = "frame=12&module=4&camera=-62.5,24,0.6,0.05,-0.1&colour=speed&path=1&follow=0"
TIMEOUT_S = 30


@pytest.fixture(scope="module")
def fold(service: Service) -> str:
    return service.fold(SNAKE)["id"]


def open_socket(service: Service, path: str, **headers: str) -> ClientConnection:
    return connect(f"ws://{service.netloc}{path}", additional_headers=headers)


def refusal(service: Service, path: str, **headers: str) -> int:
    with pytest.raises(InvalidStatus) as refused, open_socket(service, path, **headers):
        pass
    return refused.value.response.status_code


def ending(connection: Connection) -> tuple[int, str]:
    """Read until the socket is closed, and return the code and the reason."""
    with pytest.raises(ConnectionClosed) as closed:
        while True:
            connection.recv(TIMEOUT_S)
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code, closed.value.rcvd.reason


def test_followers_see_the_view_of_the_leader_until_it_leaves(service: Service, fold: str) -> None:
    with open_socket(service, f"/api/class/lead?fold={fold}") as leader:
        message = json.loads(leader.recv(TIMEOUT_S))
        assert message["picture"].startswith("data:image/svg+xml")
        path = message["link"].removeprefix(f"http://{service.netloc}")
        code = path.removeprefix("/c/")
        joined = service.http.get(path.lower())
        assert (joined.status_code, joined.headers["location"]) == (
            303,
            f"/folds/{fold}?class={code}",
        )
        with (
            open_socket(service, f"/api/class/follow?code={code}") as client_connection,
            open_socket(service, f"/api/class/follow?code={code}") as other_client_connection,
        ):
            assert (
                client_connection.recv(TIMEOUT_S) == other_client_connection.recv(TIMEOUT_S) == ""
            )
            while json.loads(leader.recv(TIMEOUT_S)) != {"followers": 2}:
                pass
            leader.send(VIEW)
            assert (
                client_connection.recv(TIMEOUT_S) == other_client_connection.recv(TIMEOUT_S) == VIEW
            )
            other_client_connection.send("frame=1")  # followers may not send
            assert ending(other_client_connection)[0] == 1008
            leader.close()
            assert ending(client_connection) == (1000, "over")
    assert service.http.get(path).status_code == 404
    assert refusal(service, f"/api/class/follow?code={code}") == 404


def test_class_of_a_leader_who_sends_nonsense_or_floods_ends(service: Service, fold: str) -> None:
    for messages in (["<script>"], [b"frame=1"], [f"frame={k}" for k in range(1000)]):
        with open_socket(service, f"/api/class/lead?fold={fold}") as leader:
            code = json.loads(leader.recv(TIMEOUT_S))["link"].rpartition("/")[2]
            with open_socket(service, f"/api/class/follow?code={code}") as follower:
                assert follower.recv(TIMEOUT_S) == ""
                with suppress(ConnectionClosed):
                    for message in messages:
                        leader.send(message)
                received_messages: list[str | bytes] = []
                with pytest.raises(ConnectionClosed):
                    while True:
                        received_messages.append(follower.recv(TIMEOUT_S))
                assert len(received_messages) <= MAX_VIEWS_PER_SECOND
                assert all(is_view(str(received_message)) for received_message in received_messages)


def test_class_waits_for_a_leader_whose_connection_is_lost(service: Service, fold: str) -> None:
    leader = open_socket(service, f"/api/class/lead?fold={fold}")
    back_state = json.loads(leader.recv(TIMEOUT_S))["back"]
    code, key = back_state["code"], back_state["key"]
    assert len(key) >= 20
    with open_socket(service, f"/api/class/follow?code={code}") as follower:
        leader.send("frame=1")
        while follower.recv(TIMEOUT_S) != "frame=1":
            pass
        leader.socket.shutdown(socket.SHUT_RDWR)  # simulates a network failure
        for wrong in (f"code={code}&key={key[:-1]}", f"code={code}&key=", f"code=A&key={key}"):
            assert refusal(service, f"/api/class/lead?fold={fold}&{wrong}") == 404
        with open_socket(
            service, f"/api/class/lead?code={code}&key={key}"
        ) as second_client_connection:
            assert json.loads(second_client_connection.recv(TIMEOUT_S))["back"] == back_state
            assert json.loads(second_client_connection.recv(TIMEOUT_S)) == {"followers": 1}
            second_client_connection.send("frame=2")
            assert follower.recv(TIMEOUT_S) == "frame=2"
            with open_socket(service, f"/api/class/lead?code={code}&key={key}") as newest:
                assert ending(second_client_connection)[0] == 1000  # the latest connection leads
                newest.send("frame=3")
                assert follower.recv(TIMEOUT_S) == "frame=3"
        assert ending(follower) == (1000, "over")


def test_class_is_refused_before_it_begins(service: Service, fold: str) -> None:
    for query in ("lead?fold=nothing", "lead?fold=../etc", "follow?code=AAAA"):
        assert refusal(service, f"/api/class/{query}") == 404
    assert refusal(service, f"/api/class/lead?fold={fold}", Origin="http://evil.example") == 403


def test_view_has_known_words_with_proper_values_only() -> None:
    wrong = "frame=-1 frame=1e3 frame=1&frame=2 camera=1,2 camera=a,b,c colour=Red path=2 follow=1"
    extra = "theme=dark tour=1 frame & frame=1& frame=1# frame=१"
    for text in (*wrong.split(), *extra.split(), f"camera={'1' * 300},,1"):
        assert not is_view(text), text
    assert is_view(VIEW)
    assert is_view("")


def test_classes_and_followers_are_limited_and_codes_are_long() -> None:
    classes = LiveClasses(Settings())
    leaders = [classes.leaders.enter("192.0.2.1") for _ in range(4)]
    with pytest.raises(TooMany):
        classes.leaders.enter("192.0.2.1")
    assert len(leaders) == len(classes.leaders)
    for _ in range(MAX_FOLLOWERS):
        classes.followers.enter("192.0.2.1")
    with pytest.raises(TooMany):
        classes.followers.enter("192.0.2.1")
    with classes.begun("a") as leader, classes.begun("a") as second:
        assert len(leader.code) == len(second.code) == CODE_LENGTH >= 12
        assert leader.code != second.code
        leader.followers = MAX_FOLLOWERS
        with pytest.raises(TooMany), leader.joined():
            pass
    with pytest.raises(NoSuch):
        classes.find(leader.code)
