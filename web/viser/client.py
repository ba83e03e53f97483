"""Client: viser's own page, adapted for a frame in the service's pages, and its policy."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from foldback.web.static_files import code_of

# The page unpacks its program into an inline script and makes no requests.
CONTENT_POLICY: Final = "; ".join(
    (
        "default-src 'none'",
        "script-src 'unsafe-inline' 'wasm-unsafe-eval'",
        "style-src 'unsafe-inline'",
        "img-src data:",
        "font-src data:",
        "base-uri 'none'",
        "form-action 'none'",
    )
)
# This hides viser's panel, notices and logo, because the page has its own. The document paints the
# background, so the canvas above it stays transparent.
CLIENT_STYLE: Final = """
html { color-scheme: light dark !important; }
html, body { background: radial-gradient(120% 90% at 50% 38%, light-dark(#fbfaf7, #23282f) 0%,
  light-dark(#efece6, #15181d) 60%, light-dark(#e2ded6, #0d0f12) 100%) !important; }
#root div { background-color: transparent !important; }
.mantine-Notifications-root, .mantine-Paper-root, .mantine-Tooltip-tooltip,
.mantine-Modal-root { display: none !important; }
"""


@dataclass(frozen=True, slots=True)
class Client:
    """The page and its security policy.

    Attributes:
        html: The page. It also states its policy itself, as far as a page can, for downloaded
            pages, which no server sends.
        policy: Its Content-Security-Policy. The page has an origin of its own (``sandbox``), so its
            scripts cannot access the service.
    """

    html: bytes
    policy: str


@cache
def client() -> Client:
    """Return the client of the installed viser, which the surrounding page controls.

    The messages between them are in ``static/js/viewer/bridge.js``. The file is read once.
    """
    bridge = code_of("js/viewer/bridge.js")
    # Located without importing it, because the page does not need viser's server.
    installed = find_spec("viser")
    assert installed is not None and installed.origin is not None
    source = Path(installed.origin).parent / "client" / "build" / "index.html"
    html = source.read_text(encoding="utf-8")
    start = html.index("<head>") + len("<head>")
    head = html.rindex("</head>")
    html = (
        f'{html[:start]}<meta http-equiv="Content-Security-Policy" content="{CONTENT_POLICY}">'
        f"<script>{bridge}</script>{html[start:head]}<style>{CLIENT_STYLE}</style>{html[head:]}"
    )
    policy = f"{CONTENT_POLICY}; frame-ancestors 'self'; sandbox allow-scripts"
    return Client(html.encode(), policy)
