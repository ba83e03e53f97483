"""Attackers' scripts in the 3D view, a third-party program in a frame of our pages."""

import base64
import re
from pathlib import Path
from urllib.parse import quote

import msgspec
import pytest
import viser
import zstandard
from playwright.sync_api import Frame, Page, expect
from viser import _messages as messages

from tests.browser.conftest import Visit
from tests.server.files.test_preview import stl
from tests.server.service_process import Service

SMALL = {"width": 320, "height": 240}
"""Window size in pixels that software rendering paints quickly."""
MARK = "a stranger's script saw"
STORED = {"foldback:owner:mine": "a token"}
SCRIPT = f'console.log("{MARK} " + JSON.stringify(localStorage))'
FIND_REACHABLE = """async () => {
  const asked = (begin) => new Promise((done, failed) => begin(() => done(true), failed));
  const ways = {
    storage: () => localStorage.length + 1,
    cookies: () => document.cookie.length + 1,
    databases: () => asked((done, failed) => {
      const opening = indexedDB.open("x");
      opening.onsuccess = done;
      opening.onerror = failed;
    }),
    page: () => parent !== window && parent.document.body,
    service: () => asked((done, failed) => {
      const request = new XMLHttpRequest();
      request.open("GET", "/api/folds");
      request.onload = done;
      request.onerror = failed;
      request.send();
    }),
    pictures: () => asked((done, failed) => {
      const picture = new Image();
      picture.onload = done;
      picture.onerror = failed;
      picture.src = "/static/icon.svg";
    }),
  };
  const reached = [];
  for (const [what, reach] of Object.entries(ways)) {
    try { if (await reach()) reached.push(what); } catch { }
  }
  return reached;
}"""
"""Objects that a script in the view can access."""
HAND_OVER_PORTS = """async ([messages]) => {
  const [view] = document.querySelectorAll("iframe");
  const hand = () => {
    const { port1, port2 } = new MessageChannel();
    const heard = [];
    port1.onmessage = ({ data }) => heard.push(data.is);
    view.contentWindow.postMessage({ keys: [] }, "*", [port2]);
    port1.postMessage({ do: "pass", id: 1 });
    return [port1, heard];
  };
  const [first, heard] = hand();
  const [, later] = hand();
  while (!heard.includes("open")) await new Promise(requestAnimationFrame);
  first.postMessage({ do: "show", messages });
  first.postMessage({ do: "pass", id: 2 });
  while (heard.filter((is) => is === "done").length < 2) await new Promise(requestAnimationFrame);
  return later;
}"""


def notice_messages() -> list[dict[str, object]]:
    """Return messages of viser: a notice with a picture that runs a script."""
    html = f"<img src='data:,' onerror='{SCRIPT.replace(chr(39), '&#39;')}'>"
    encoded = (
        messages.GuiModalMessage(order=0.0, uuid="notice", title=""),
        messages.GuiHtmlMessage(
            uuid="html",
            container_uuid="notice",
            props=messages.GuiHtmlProps(order=0.0, content=html, visible=True),
        ),
    )
    return [message.as_serializable_dict() for message in encoded]


def recording_url() -> str:
    """Return these messages as a recording, encoded as a data URL."""
    encoded = msgspec.msgpack.encode(
        {
            "viserVersion": viser.__version__,
            "durationSeconds": 1.0,
            "messages": [(0.0, message) for message in notice_messages()],
            "binaryBufferLengths": [],
        }
    )
    raw = len(encoded).to_bytes(8, "little") + encoded
    data = len(raw).to_bytes(8, "little") + zstandard.compress(raw)
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def page_with_secrets(visit: Visit, address: str = "/health") -> Page:
    """Return a page whose browser stores something for our origin that an attacker could steal."""
    page = visit(address, **SMALL)
    page.evaluate("(kept) => Object.assign(localStorage, kept)", STORED)
    return page


OTHER_PAGES = ("/embed/{0}", "/compare?a={0}&b={0}", "preview")
HOSTILE_QUERY = f"playbackPath={quote(recording_url())}"


def open_hostile(page: Page, address: str) -> list[str]:
    """Open an address with a hostile query and fragment; return its console messages from then on.

    A site that frames our pages can set the addresses of the frames in them as well.
    """
    logs: list[str] = []
    page.on("console", lambda message: logs.append(message.text))
    page.goto(f"{address}{'&' if '?' in address else '?'}{HOSTILE_QUERY}#{HOSTILE_QUERY}")
    return logs


def wait_for_client(frame: Frame) -> Frame:
    """Return the frame of viser's client once it has begun to draw."""
    frame.locator("#root canvas").first.wait_for(state="attached")
    frame.evaluate("() => new Promise((done) => setTimeout(() => requestAnimationFrame(done)))")
    return frame


def hostile_clients(page: Page) -> list[Frame]:
    """Return the clients that a page frames, with hostile addresses where they have one.

    The addresses are set as soon as the frames have any: the first client to load takes the scene.
    """
    frames: list[Frame] = []
    for view in page.locator("iframe").all():
        expect(view).to_have_attribute(*VIEW_TITLE)
        view.and_(page.locator("[src], [srcdoc]")).wait_for(state="attached")
        element = view.element_handle()
        element.evaluate(SET_ADDRESS, HOSTILE_QUERY)
        frame = element.content_frame()
        assert frame
        frames.append(wait_for_client(frame))
    return frames


VIEW_TITLE = ("title", re.compile("^3D view"))
SET_ADDRESS = """(frame, asked) => frame.getAttribute("src") && new Promise((done) => {
  frame.addEventListener("load", done, { once: true });
  frame.src += `?${asked}#${asked}`;
})"""


def assert_harmless(frames: list[Frame], logs: list[str]) -> None:
    for frame in frames:
        assert frame.evaluate("() => location.search + location.hash") == ""
        assert frame.evaluate(FIND_REACHABLE) == []
    assert not [words for words in logs if MARK in words]


@pytest.mark.parametrize("address", ["/view", pytest.param("/embed/view", marks=pytest.mark.long)])
def test_view_opened_directly_is_harmless(visit: Visit, address: str) -> None:
    page = page_with_secrets(visit)
    logs = open_hostile(page, address)
    assert_harmless([wait_for_client(page.main_frame)], logs)


@pytest.mark.parametrize(
    "address",
    [
        "/folds/{0}",
        *(pytest.param(other_page, marks=pytest.mark.long) for other_page in OTHER_PAGES),
    ],
)
def test_view_in_fold_pages_is_harmless(
    visit: Visit, service: Service, wrench: str, address: str
) -> None:
    if address == "preview":
        address = service.preview("brick.stl", stl())["links"]["page"]
    page = page_with_secrets(visit)
    logs = open_hostile(page, address.format(wrench))
    frames = hostile_clients(page)
    assert len(frames) == (2 if "compare" in address else 1)
    assert_harmless(frames, logs)


def test_view_in_a_downloaded_page_is_harmless(
    visit: Visit, service: Service, wrench: str, tmp_path: Path
) -> None:
    path = tmp_path / "fold.html"
    path.write_bytes(service.http.get(f"/folds/{wrench}/standalone.html").content)
    page = visit("about:blank", **SMALL)
    logs = open_hostile(page, path.as_uri())
    page.evaluate("(kept) => Object.assign(localStorage, kept)", STORED)
    frames = hostile_clients(page)
    assert len(frames) == 1
    assert_harmless(frames, logs)


@pytest.mark.long
def test_view_plays_nothing_when_its_query_stays(visit: Visit) -> None:
    script = "History.prototype.replaceState = () => { throw new DOMException('no'); }"
    page = visit("about:blank", script=script, **SMALL)
    logs = open_hostile(page, "/view")
    frame = wait_for_client(page.main_frame)
    assert "playbackPath" in frame.evaluate("() => location.search")
    assert_harmless([], logs)


def test_view_accepts_one_port_and_only_from_its_page(visit: Visit) -> None:
    page = page_with_secrets(visit)
    logs = open_hostile(page, "/shapes/new")
    page.evaluate(
        """() => Promise.all([0, 1].map(() => new Promise((done) => {
          const view = document.createElement("iframe");
          Object.assign(view, { src: "/view", title: "3D view", onload: done });
          view.sandbox = "allow-scripts";
          view.style = "position: fixed; top: 0"; // invisible frames are not drawn
          document.body.append(view);
        })))"""
    )
    view, beside = (wait_for_client(frame) for frame in page.frames[1:])
    beside.evaluate(
        """() => {
          const { port1, port2 } = new MessageChannel();
          window.heard = [];
          port1.onmessage = ({ data }) => heard.push(data);
          parent.frames[0].postMessage({ keys: [] }, "*", [port2]);
          port1.postMessage({ do: "pass", id: 1 });
        }"""
    )
    # The view ignores a second port, and messages that are no part of a scene.
    assert page.evaluate(HAND_OVER_PORTS, [notice_messages()]) == []
    assert beside.evaluate("() => heard") == []
    assert view.locator("[onerror]").count() == 0
    assert_harmless([view, beside], logs)
