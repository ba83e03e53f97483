"""Firefox for tests and benchmarks, driven by WebDriver BiDi, which Firefox itself serves."""

import json
import os
import re
import subprocess
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import connect
from websockets.sync.connection import Connection

from tests.browser.conftest import TIMEOUT_MS
from tests.tools import FIREFOX, XVFB

CENTRE = """((selector) => {
  const element = document.querySelector(selector);
  if (!element?.checkVisibility() || element.disabled) return null;
  element.scrollIntoView({ block: "nearest" });
  const box = element.getBoundingClientRect();
  return JSON.stringify([box.x + box.width / 2, box.y + box.height / 2].map(Math.round));
})"""
"""Function that returns the centre of an element as JSON; null if nobody could click it."""
NO_WEBGL = """() => {
  const { prototype } = HTMLCanvasElement;
  const { getContext } = prototype;
  prototype.getContext = function (kind, ...options) {
    return kind.startsWith("webgl") ? null : getContext.call(this, kind, ...options);
  };
}"""
"""Function that keeps pages from drawing with WebGL."""


class Firefox:
    """Firefox with one tab at a time, driven by WebDriver BiDi, which Firefox itself serves.

    Args:
        socket: Connection to the browser.
    """

    def __init__(self, socket: Connection) -> None:
        self.errors: list[str] = []
        self._socket = socket
        self._sent = 0
        self.send("session.new", capabilities={})
        self.send("session.subscribe", events=["log.entryAdded"])
        self._tab = ""

    @contextmanager
    def tab(self, *, webgl: bool) -> Generator[None]:
        """Use a tab with an empty profile of its own."""
        profile = self.send("browser.createUserContext")
        self._tab = self.send("browsingContext.create", type="tab", **profile)["context"]
        if not webgl:
            self.send("script.addPreloadScript", functionDeclaration=NO_WEBGL, contexts=[self._tab])
        yield
        self.send("browser.removeUserContext", **profile)

    def send(self, method: str, **params: Any) -> Any:
        """Send a command and return its result; keep the errors that pages log meanwhile."""
        self._sent += 1
        self._socket.send(json.dumps({"id": self._sent, "method": method, "params": params}))
        while True:
            answer = json.loads(self._socket.recv(TIMEOUT_MS / 1000))
            if answer.get("id") == self._sent:
                assert answer["type"] == "success", answer
                return answer["result"]
            entry = answer["params"]
            if entry.get("level") == "error":
                self.errors.append(f"{entry['text']} {entry.get('stackTrace')}")

    def open(self, address: str) -> None:
        self.send("browsingContext.navigate", context=self._tab, url=address, wait="interactive")

    def run(self, expression: str) -> Any:
        """Return the value of an expression in the page; it must be a plain one."""
        target = {"context": self._tab}
        answer = self.send(
            "script.evaluate", expression=expression, target=target, awaitPromise=True
        )
        assert answer["type"] == "success", answer
        return answer["result"].get("value")

    def until(self, expression: str) -> Any:
        """Wait until an expression in the page is true, and return its value."""
        return self.run(f"""new Promise((resolve, reject) => {{
          const begin = performance.now();
          const check = () => {{
            const value = {expression};
            if (value) resolve(value);
            else if (performance.now() - begin > {TIMEOUT_MS}) reject({expression!r});
            else setTimeout(check, 50);
          }};
          check();
        }})""")

    def click(self, selector: str) -> None:
        """Click an element once it is visible and enabled."""
        x, y = json.loads(self.until(f"{CENTRE}({selector!r})"))
        press = [{"type": f"pointer{action}", "button": 0} for action in ("Down", "Up")]
        moves = [{"type": "pointerMove", "x": x, "y": y}, *press]
        self._act({"type": "pointer", "id": "mouse", "actions": moves})

    def type(self, keys: str) -> None:
        """Press keys one after another."""
        actions = [{"type": f"key{way}", "value": key} for key in keys for way in ("Down", "Up")]
        self._act({"type": "key", "id": "keyboard", "actions": actions})

    def _act(self, source: dict[str, Any]) -> None:
        self.send("input.performActions", context=self._tab, actions=[source])


@contextmanager
def display() -> Generator[dict[str, str]]:
    """Run a display that nobody sees, on which Firefox has WebGL; yield its variables."""
    receiver, sender = os.pipe()
    command = [XVFB.get(), "-displayfd", str(sender), "-screen", "0", "1366x768x24"]
    with subprocess.Popen(command, pass_fds=(sender,), stderr=subprocess.DEVNULL) as server:
        os.close(sender)
        with open(receiver, encoding="utf-8") as numbers:
            number = numbers.readline().strip()
        try:
            yield {"DISPLAY": f":{number}", "LIBGL_ALWAYS_SOFTWARE": "1"}
        finally:
            server.terminate()


@contextmanager
def opened_firefox(profile: Path) -> Generator[Firefox]:
    """Run Firefox with a profile, which is an empty directory."""
    preferences = {
        "webgl.force-enabled": True,
        "services.settings.server": "data:,",  # no request to the maker's servers
    }
    lines = [f"user_pref('{name}', {json.dumps(value)});" for name, value in preferences.items()]
    (profile / "user.js").write_text("\n".join(lines))
    command = [FIREFOX.get(), "--profile", str(profile), "--remote-debugging-port", "0"]
    with (
        display() as variables,
        subprocess.Popen(
            command, env={**os.environ, **variables}, stderr=subprocess.PIPE, text=True
        ) as program,
    ):
        assert program.stderr is not None
        listening = (re.search(r"BiDi listening on (ws:\S+)", line) for line in program.stderr)
        address = next(match[1] for match in listening if match)
        try:
            with connect(f"{address}/session", max_size=None, proxy=None) as socket:
                yield Firefox(socket)
        finally:
            program.terminate()
