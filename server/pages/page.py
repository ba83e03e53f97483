"""A page: a rendered template with the security policy of all pages."""

from __future__ import annotations

import base64
import hashlib
import json
from functools import cache
from typing import Final
from urllib.parse import quote

from fastapi import Request
from fastapi.responses import HTMLResponse, Response
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from foldback.planner.parameters.option import options_of
from foldback.planner.pipeline.request import FoldRequest
from foldback.planner.readers.formats import PICTURE_SUFFIXES, READABLE_SUFFIXES
from foldback.server.http.base_path import BASE_PATH, at
from foldback.server.http.security import INDEXED_HEADERS
from foldback.web.static_files import VERSIONED, code_of, scripts_of, scripts_version, text_of
from foldback.words.curves import CURVE_LABELS, EXTREMES
from foldback.words.settings import PAPER_ROWS, ROBOT_ROWS, SOURCE_LABELS, TABLE_ROWS

THEME_SCRIPT: Final = "js/theme.js"
"""Script that sets the light or dark theme before the page is painted; the only inline script of
pages."""


@cache
def policy_of_pages() -> str:
    """Return the content security policy of pages; it permits only their own inline script."""
    theme = base64.b64encode(hashlib.sha256(code_of(THEME_SCRIPT).encode()).digest()).decode()
    return "; ".join(
        (
            "default-src 'none'",
            f"script-src 'self' 'sha256-{theme}'",
            "style-src 'self' 'unsafe-inline'",
            "img-src 'self' data:",
            "connect-src 'self'",
            "frame-src 'self'",
            "manifest-src 'self'",
            "form-action 'self'",
            "base-uri 'none'",
            "frame-ancestors 'self'",
        )
    )


@cache
def icon() -> str:
    """Return the icon for browser tabs, as a data URL."""
    return "data:image/svg+xml," + quote(text_of("icon.svg"), safe=" =:/'")


@cache
def theme_script() -> Markup:
    """Return the script element that sets the theme, for the head of every page."""
    return Markup("<script>{}</script>").format(Markup(code_of(THEME_SCRIPT)))


@cache
def script_addresses(page_name: str) -> tuple[str, ...]:
    """Return the addresses of a page's entry script and of all its static imports."""
    names = scripts_of(f"js/pages/{page_name}.js", later=False)
    return tuple(f"/static/{VERSIONED}/{scripts_version()}/{name}" for name in names)


def entry(page_name: str) -> Markup:
    """Return the tags of a page's entry script and of all its static imports."""
    first, *later_addresses = script_addresses(page_name)
    preloads = (
        Markup('<link rel="modulepreload" href="{}">').format(at(name)) for name in later_addresses
    )
    script = Markup('<script type="module" src="{}"></script>').format(at(first))
    return Markup("").join((*preloads, script))


TEMPLATE_VALUES: Final[dict[str, object]] = {
    "at": at,
    "site": None,
    "curve_labels": CURVE_LABELS,
    "curve_extremes": EXTREMES,
    "readable_suffixes": ",".join(READABLE_SUFFIXES),
    "picture_suffixes": ",".join(PICTURE_SUFFIXES),
    "paper_settings": PAPER_ROWS,
    "table_settings": TABLE_ROWS,
    "robot_settings": ROBOT_ROWS,
    "options": options_of(FoldRequest),
    "setting_sources": SOURCE_LABELS,
    "entry": entry,
    "icon": icon,
    "theme_script": theme_script,
}
"""Variables that are available in every HTML template."""


def page(
    template: str, status_code: int = 200, /, *, listed: bool = False, **values: object
) -> Response:
    """Return a page from a template, with the security policy of all pages.

    Args:
        template: Name of the template.
        status_code: HTTP status of the response.
        listed: True if search engines may index it.
        values: Values for the template.
    """
    html = rendered(template, **values)
    headers = {"Content-Security-Policy": policy_of_pages(), "Cache-Control": "no-store"}
    if listed:
        headers |= INDEXED_HEADERS
    return HTMLResponse(html, status_code=status_code, headers=headers)


def rendered(template: str, /, **values: object) -> str:
    """Render a template."""
    return templates().get_template(template, globals=TEMPLATE_VALUES).render(**values)


@cache
def templates() -> Environment:
    """Return the environment of all templates."""
    return Environment(
        loader=PackageLoader("foldback.web", "templates"),
        autoescape=select_autoescape(),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def drawing(svg: str, cache_control: str) -> Response:
    """Return the response with a drawing, in which no script can run; 404 if it is empty."""
    if not svg:
        return not_found()
    headers = {"Cache-Control": cache_control, "Content-Security-Policy": "default-src 'none'"}
    return Response(svg, media_type="image/svg+xml", headers=headers)


def not_found() -> Response:
    """Return the response for a missing file."""
    return Response("not found", status_code=404, media_type="text/plain")


def origin_of(request: Request) -> str:
    """Return the address at which visitors see the service: scheme, host and base path."""
    return str(request.base_url).rstrip("/") + BASE_PATH.get()


def script_json(value: object) -> str:
    """Return JSON that is safe inside a script element."""
    text = json.dumps(value, ensure_ascii=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
