"""Client: viser's own page, dressed for being framed by ours, and the policy it needs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Final

from web.static_files import code_of

# The page unpacks its own program into an inline script, and asks nobody for anything.
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
# The panel, the notices and the logo are viser's; the page has its own. The ground is painted by
# the document, so the canvas above it stays see-through.
CLIENT_STYLE: Final = """
html { color-scheme: light dark !important; }
html, body { background: radial-gradient(120% 90% at 50% 38%, light-dark(#fbfaf7, #23282f) 0%,
  light-dark(#efece6, #15181d) 60%, light-dark(#e2ded6, #0d0f12) 100%) !important; }
#root div { background-color: transparent !important; }
.mantine-Notifications-root, .mantine-Paper-root, .mantine-Tooltip-tooltip,
.mantine-Modal-root { display: none !important; }
html.yields canvas { touch-action: pan-y !important; }
canvas:focus { outline: none; }
"""


@dataclass(frozen=True, slots=True)
class Client:
    """The page, and what it is served with.

    Attributes:
        html: The page. It says itself what it may do, as far as a page can, for where it is not
            served: in a page that was downloaded.
        policy: Its Content-Security-Policy. The page has an origin of its own (``sandbox``): its
            scripts reach nothing of ours.
    """

    html: bytes
    policy: str


@cache
def client() -> Client:
    """Return the installed viser's client, told what to show by the page that frames it.

    See ``static/js/viewer/bridge.js``; read once.
    """
    bridge = code_of("js/viewer/bridge.js")
    # Found without importing it: the page alone needs none of its server.
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
