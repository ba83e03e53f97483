from __future__ import annotations

import contextlib
import gc
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import viser
from viser import _messages as messages

from web.client import MESSAGES_IN, client
from web.viewers import MOST_SOCKETS, Viewers, ViewersBusy

VISITOR = "visitor-number-one"
OTHER = "visitor-number-two"


@pytest.fixture
def viewers() -> Iterator[Viewers]:
    viewers = Viewers(max_viewers=2, idle_s=60.0)
    yield viewers
    viewers.close()


def wait_for(true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 30
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_everybody_has_a_playhead_of_their_own(viewers: Viewers, timeline_path: Path) -> None:
    one = viewers.open("fold", VISITOR, timeline_path)
    two = viewers.open("fold", OTHER, timeline_path)
    one.player.handle({"do": "seek", "frame": 50})
    assert (one.player.head.frame, two.player.head.frame) == (50.0, 0.0)
    assert one.port != two.port
    assert viewers.open("fold", VISITOR, timeline_path) is one


def test_servers_listen_on_the_loopback_interface_only(
    viewers: Viewers, timeline_path: Path
) -> None:
    assert viewers.open("fold", VISITOR, timeline_path).server.get_host() == "127.0.0.1"


@pytest.mark.parametrize("visitor", ["", "short", "x" * 65, "has/slash-in-the-token"])
def test_tokens_of_another_form_are_refused(
    viewers: Viewers, timeline_path: Path, visitor: str
) -> None:
    with pytest.raises(ValueError, match="visitor token"):
        viewers.open("fold", visitor, timeline_path)


def test_the_longest_unused_makes_room(viewers: Viewers, timeline_path: Path) -> None:
    viewers.open("fold", VISITOR, timeline_path)
    kept = viewers.open("fold", OTHER, timeline_path)
    viewers.open("fold", "visitor-number-three", timeline_path)
    assert len(viewers) == 2
    assert viewers.open("fold", OTHER, timeline_path) is kept


def test_nobody_is_thrown_out_for_another(viewers: Viewers, timeline_path: Path) -> None:
    one = viewers.open("fold", VISITOR, timeline_path)
    two = viewers.open("fold", OTHER, timeline_path)
    with one.connected(), two.connected(), pytest.raises(ViewersBusy, match="try again"):
        viewers.open("fold", "visitor-number-three", timeline_path)


def test_nobody_takes_all_viewers_alone(timeline_path: Path) -> None:
    viewers = Viewers(max_viewers=10, max_of_address=2)
    try:
        one = viewers.open("fold", VISITOR, timeline_path, address="here")
        two = viewers.open("other fold", OTHER, timeline_path, address="here")
        with one.connected(), two.connected():
            with pytest.raises(ViewersBusy, match="You have 2 views open"):
                viewers.open("fold", "visitor-number-three", timeline_path, address="here")
            viewers.open("fold", "visitor-number-three", timeline_path, address="elsewhere")
            assert viewers.open("fold", VISITOR, timeline_path, address="here") is one
        assert len(viewers) == 3
    finally:
        viewers.close()


def test_one_fold_does_not_take_all_viewers(timeline_path: Path) -> None:
    viewers = Viewers(max_viewers=10, max_of_fold=1)
    try:
        one = viewers.open("fold", VISITOR, timeline_path, address="here")
        with one.connected():
            with pytest.raises(ViewersBusy, match="this fold"):
                viewers.open("fold", OTHER, timeline_path, address="elsewhere")
            viewers.open("other fold", OTHER, timeline_path, address="elsewhere")
    finally:
        viewers.close()


def test_what_a_visitor_has_left_makes_room_for_the_same_visitor_first(
    timeline_path: Path,
) -> None:
    viewers = Viewers(max_viewers=3, max_of_address=2)
    try:
        others = viewers.open("fold", "visitor-elsewhere", timeline_path, address="elsewhere")
        left = viewers.open("fold", VISITOR, timeline_path, address="here")
        kept = viewers.open("fold", OTHER, timeline_path, address="here")
        with kept.connected():
            # At one's own bound, and at the bound in all, though the other's is longer unused.
            viewers.open("fold", "visitor-number-three", timeline_path, address="here")
            assert viewers.open("fold", OTHER, timeline_path, address="here") is kept
            assert viewers.open("fold", "visitor-elsewhere", timeline_path) is others
            again = viewers.open("fold", VISITOR, timeline_path, address="here")
            assert again.epoch != left.epoch
            assert viewers.open("fold", "visitor-elsewhere", timeline_path) is others
    finally:
        viewers.close()


def test_one_viewer_has_not_any_number_of_connections(
    viewers: Viewers, timeline_path: Path
) -> None:
    viewer = viewers.open("fold", VISITOR, timeline_path)
    with contextlib.ExitStack() as open_sockets:
        for _ in range(MOST_SOCKETS):
            open_sockets.enter_context(viewer.connected())
        with pytest.raises(ViewersBusy, match="too many connections"):
            viewers.open("fold", VISITOR, timeline_path)
    assert viewers.open("fold", VISITOR, timeline_path) is viewer


def test_an_idle_viewer_is_closed_and_comes_back(timeline_path: Path) -> None:
    viewers = Viewers(max_viewers=5, idle_s=0.2)
    try:
        first = viewers.open("fold", VISITOR, timeline_path)
        with first.connected():
            time.sleep(0.5)
            assert len(viewers) == 1
        wait_for(lambda: len(viewers) == 0)
        again = viewers.open("fold", VISITOR, timeline_path)
        assert again.epoch != first.epoch
        assert again.player.snapshot is not None
    finally:
        viewers.close()


def test_playing_goes_on_by_itself_while_somebody_looks(
    viewers: Viewers, timeline_path: Path
) -> None:
    viewer = viewers.open("fold", VISITOR, timeline_path)
    with viewer.connected():
        viewer.player.handle({"do": "play"})
        wait_for(lambda: viewer.player.head.frame > 2)


def test_closed_viewers_open_no_more(timeline_path: Path) -> None:
    viewers = Viewers()
    viewers.open("fold", VISITOR, timeline_path)
    viewers.close()
    assert len(viewers) == 0
    with pytest.raises(ViewersBusy, match="closing"):
        viewers.open("fold", VISITOR, timeline_path)


def test_one_film_serves_all_who_look(viewers: Viewers, timeline_path: Path) -> None:
    films = viewers._films._films
    one = viewers.open("fold", VISITOR, timeline_path)
    viewers.open("fold", OTHER, timeline_path)
    assert len(films) == 1
    del one
    viewers.close()
    gc.collect()
    assert len(films) == 0


def test_nothing_is_printed(
    viewers: Viewers, timeline_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    viewers.open("fold", VISITOR, timeline_path)
    viewers.close()
    assert capsys.readouterr().out == ""


# What is leaned on in viser that it calls private. A rename there fails here.


def test_the_tunnel_to_a_third_party_cannot_be_asked_for(
    viewers: Viewers, timeline_path: Path
) -> None:
    plain = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    asked = {messages.ShareUrlRequest, messages.ShareUrlDisconnect}
    try:
        assert asked <= set(plain._websock_server._incoming_handlers)
        ours = viewers.open("fold", VISITOR, timeline_path).server
        assert not asked & set(ours._websock_server._incoming_handlers)
    finally:
        plain.stop()


def test_messages_that_are_let_in_exist() -> None:
    for name in MESSAGES_IN:
        assert issubclass(getattr(messages, name), messages.Message)


def test_camera_messages_are_as_they_are_sent() -> None:
    fields = (
        messages.SetCameraPositionMessage((1.0, 2.0, 3.0)),
        messages.SetCameraLookAtMessage((1.0, 2.0, 3.0)),
    )
    assert fields[0].position == fields[1].look_at == (1.0, 2.0, 3.0)
    assert not fields[0].initial
    assert not fields[1].initial


def test_client_page_is_dressed_and_bound() -> None:
    page = client()
    assert page.html.count(b"</head>") == 1
    assert b"mantine-Paper-root" in page.html.split(b"</head>")[0][-2000:]
    assert "connect-src 'self' data: blob:" in page.policy
    assert "frame-ancestors 'self'" in page.policy
