"""Strangers' scripts in the 3D view, which is a program of others in a frame of our pages."""

from __future__ import annotations

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
KEPT = {"foldback:owner:mine": "a token"}
RUNS = f'console.log("{MARK} " + JSON.stringify(localStorage))'
REACHES = """async () => {
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
HANDED = """async ([messages]) => {
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


def notice() -> list[dict[str, object]]:
    """Messages of viser's: a notice with a picture that runs a script."""
    html = f"<img src='data:,' onerror='{RUNS.replace(chr(39), '&#39;')}'>"
    told = (
        messages.GuiModalMessage(order=0.0, uuid="notice", title=""),
        messages.GuiHtmlMessage(
            uuid="html",
            container_uuid="notice",
            props=messages.GuiHtmlProps(order=0.0, content=html, visible=True),
        ),
    )
    return [message.as_serializable_dict() for message in told]


def recording() -> str:
    """The same as a recording, and that as an address."""
    told = msgspec.msgpack.encode(
        {
            "viserVersion": viser.__version__,
            "durationSeconds": 1.0,
            "messages": [(0.0, message) for message in notice()],
            "binaryBufferLengths": [],
        }
    )
    raw = len(told).to_bytes(8, "little") + told
    data = len(raw).to_bytes(8, "little") + zstandard.compress(raw)
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def keeping(visit: Visit, address: str = "/health") -> Page:
    """A page of a browser that keeps something to steal for our origin."""
    page = visit(address, **SMALL)
    page.evaluate("(kept) => Object.assign(localStorage, kept)", KEPT)
    return page


ELSEWHERE = ("/embed/{0}", "/compare?a={0}&b={0}", "preview")
HOSTILE = f"playbackPath={quote(recording())}"


def hostile(page: Page, address: str) -> list[str]:
    """Opens an address with a hostile query and fragment; what its console says from then on.

    Who frames a page of ours can set the addresses of the frames in it as well.
    """
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text))
    page.goto(f"{address}{'&' if '?' in address else '?'}{HOSTILE}#{HOSTILE}")
    return said


def at_work(frame: Frame) -> Frame:
    """Viser's client, when it has begun to draw."""
    frame.locator("#root canvas").first.wait_for(state="attached")
    frame.evaluate("() => new Promise((done) => setTimeout(() => requestAnimationFrame(done)))")
    return frame


def framed(page: Page) -> list[Frame]:
    """The clients that a page frames, at hostile addresses where they have one.

    They get those as they are given any: the client that comes is the first, and takes the scene.
    """
    found: list[Frame] = []
    for view in page.locator("iframe").all():
        expect(view).to_have_attribute(*GIVEN)
        view.and_(page.locator("[src], [srcdoc]")).wait_for(state="attached")
        element = view.element_handle()
        element.evaluate(READDRESSED, HOSTILE)
        frame = element.content_frame()
        assert frame
        found.append(at_work(frame))
    return found


GIVEN = ("title", re.compile("^3D view"))
READDRESSED = """(frame, asked) => frame.getAttribute("src") && new Promise((done) => {
  frame.addEventListener("load", done, { once: true });
  frame.src += `?${asked}#${asked}`;
})"""


def harmless(frames: list[Frame], said: list[str]) -> None:
    for frame in frames:
        assert frame.evaluate("() => location.search + location.hash") == ""
        assert frame.evaluate(REACHES) == []
    assert not [words for words in said if MARK in words]


@pytest.mark.parametrize("address", ["/view", pytest.param("/embed/view", marks=pytest.mark.long)])
def test_view_opened_directly_is_harmless(visit: Visit, address: str) -> None:
    page = keeping(visit)
    said = hostile(page, address)
    harmless([at_work(page.main_frame)], said)


@pytest.mark.parametrize(
    "address",
    ["/folds/{0}", *(pytest.param(each, marks=pytest.mark.long) for each in ELSEWHERE)],
)
def test_view_in_fold_pages_is_harmless(
    visit: Visit, service: Service, wrench: str, address: str
) -> None:
    if address == "preview":
        files = {"file": ("brick.stl", stl())}
        address = service.http.post("/api/shapes/preview", files=files).json()["links"]["page"]
    page = keeping(visit)
    said = hostile(page, address.format(wrench))
    frames = framed(page)
    assert len(frames) == (2 if "compare" in address else 1)
    harmless(frames, said)


def test_view_in_a_downloaded_page_is_harmless(
    visit: Visit, service: Service, wrench: str, tmp_path: Path
) -> None:
    path = tmp_path / "fold.html"
    path.write_bytes(service.http.get(f"/folds/{wrench}/standalone.html").content)
    page = visit("about:blank", **SMALL)
    said = hostile(page, path.as_uri())
    page.evaluate("(kept) => Object.assign(localStorage, kept)", KEPT)
    frames = framed(page)
    assert len(frames) == 1
    harmless(frames, said)


@pytest.mark.long
def test_view_plays_nothing_when_its_query_stays(visit: Visit) -> None:
    script = "History.prototype.replaceState = () => { throw new DOMException('no'); }"
    page = visit("about:blank", script=script, **SMALL)
    said = hostile(page, "/view")
    frame = at_work(page.main_frame)
    assert "playbackPath" in frame.evaluate("() => location.search")
    harmless([], said)


def test_view_accepts_one_port_and_only_from_its_page(visit: Visit) -> None:
    page = keeping(visit)
    said = hostile(page, "/shapes/new")
    page.evaluate(
        """() => Promise.all([0, 1].map(() => new Promise((done) => {
          const view = document.createElement("iframe");
          Object.assign(view, { src: "/view", title: "3D view", onload: done });
          view.sandbox = "allow-scripts";
          view.style = "position: fixed; top: 0"; // what nobody sees is not drawn
          document.body.append(view);
        })))"""
    )
    view, beside = (at_work(frame) for frame in page.frames[1:])
    beside.evaluate(
        """() => {
          const { port1, port2 } = new MessageChannel();
          window.heard = [];
          port1.onmessage = ({ data }) => heard.push(data);
          parent.frames[0].postMessage({ keys: [] }, "*", [port2]);
          port1.postMessage({ do: "pass", id: 1 });
        }"""
    )
    # A port handed over later is left alone, and so are messages that are no part of a scene.
    assert page.evaluate(HANDED, [notice()]) == []
    assert beside.evaluate("() => heard") == []
    assert view.locator("[onerror]").count() == 0
    harmless([view, beside], said)
