"""Exhibited folds: in a kiosk, and in a class that follows its leader."""

import re

from playwright.sync_api import Page, WebSocketRoute, expect

from bench.service.kiosk import faster
from tests.browser.conftest import Visit, seek
from tests.server.service_process import FinishedFold

TARGET_PX = 64
SPEED = 6


def count_objects(page: Page) -> dict[str, int]:
    """Return the counts of objects in the memory of the page and its folds, without garbage."""
    session = page.context.new_cdp_session(page)
    for _ in range(2):  # the first collection releases what the second one frees
        session.send("HeapProfiler.collectGarbage")
    return session.send("Memory.getDOMCounters")


def test_kiosk_plays_on_without_network_and_returns_from_a_visitor(
    visit: Visit, wrench: str, finished: FinishedFold
) -> None:
    other_id = finished.id
    for folds, status in (("nothing", 404), ("a/b", 422), (",".join(["a"] * 51), 422)):
        assert finished.http.get("/kiosk", params={"folds": folds}).status_code == status
    page = visit(f"/kiosk?kiosk=10&folds={wrench},{other_id}", view=False, script=faster(SPEED))
    frame_locator = page.frame_locator("iframe:not(.coming)")
    expect(frame_locator.locator("#tour-caption")).to_contain_text("The chain is straight")
    frame = "iframe[src='/embed/{}?kiosk=10']:not(.coming)"
    first, second = frame.format(wrench), frame.format(other_id)
    if page.locator(second).count():  # a busy machine may already show the second one
        first, second = second, first
    before = count_objects(page)
    assert frame_locator.locator("a:visible").count() == 0
    assert page.locator("a:visible").count() == 0
    for address in [
        *frame_locator.locator("button:visible, input:visible").all(),
        page.locator("#next"),
    ]:
        box = address.bounding_box()
        assert box and min(box["width"], box["height"]) >= TARGET_PX

    page.context.set_offline(True)
    page.locator("#next").click()
    expect(page.locator("iframe")).to_have_count(1)  # the next one failed to load
    expect(page.locator("#trouble")).to_be_hidden()
    expect(frame_locator.locator("#tour-count")).to_have_text(
        re.compile("^[2-9] of")
    )  # still plays
    page.context.set_offline(False)
    expect(page.locator(second)).to_be_visible()

    expect(frame_locator.locator("#tour-run")).to_have_text("Pause")
    frame_locator.locator(".surface").click()
    expect(frame_locator.locator("#tour-run")).to_have_text("Play")
    expect(page.locator(first)).to_be_visible()
    expect(page.locator("iframe")).to_have_count(1)
    third = count_objects(page)
    # The frame of the 3D view has an empty document until its own one is loaded.
    assert third["documents"] <= before["documents"] + 1
    assert third["jsEventListeners"] < 1.5 * before["jsEventListeners"], "of folds that are gone"


def test_follower_sees_the_leader_looks_around_and_returns(visit: Visit, wrench: str) -> None:
    leader = visit(f"/folds/{wrench}#frame=1", view=False)
    connections: list[tuple[WebSocketRoute, WebSocketRoute]] = []
    leader.route_web_socket(
        re.compile("/api/class/lead"),
        lambda socket: connections.append((socket, socket.connect_to_server())),
    )
    expect(leader.locator("#scrub")).to_be_enabled()
    leader.locator("#share").click()
    leader.locator("#lead").click()
    field = leader.locator(".class-code input")
    expect(field).to_have_value(re.compile(r"/c/[0-9A-Z]{12}$"))
    link = field.input_value()

    follower = visit(f"/c/{link.rpartition('/')[2]}", view=False)
    words, locator = follower.locator(".class-ways span"), follower.locator(".class-ways .primary")
    frame = follower.locator("#r-frame")
    expect(words).to_have_text("You are following the leader")
    expect(leader.locator(".class-ways span")).to_have_text("1 person is following")
    seek(leader, 30)
    expect(frame).to_have_text(re.compile("Frame 31 of"))
    leader.evaluate("() => foldback.player.send({ do: 'orbit', turn: [0.5, 0.2] })")
    azimuth = leader.evaluate("() => foldback.player.rig.choice.azimuth")
    turned = "(to) => Math.abs(foldback.player.rig.choice.azimuth - to) < 1e-3"
    follower.wait_for_function(turned, arg=azimuth)

    seek(follower, 5)
    expect(words).to_have_text("You are not following the leader")
    leader.evaluate("() => foldback.player.send({ do: 'select', module: 7 })")
    seek(leader, 40)
    locator.click()
    expect(frame).to_have_text(re.compile("Frame 41 of"))
    assert follower.evaluate("() => foldback.player.selected") == 7
    for end in connections[0]:
        end.close(code=4000)  # simulates a network failure
    expect(leader.locator(".class-ways span")).to_have_text("1 person is following")
    seek(leader, 20)
    expect(frame).to_have_text(re.compile("Frame 21 of"))
    assert len(connections) == 2
    leader.goto("/health")
    expect(words).to_have_text(re.compile("The class has ended"))
    expect(locator).to_be_hidden()
