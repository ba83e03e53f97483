"""Options of a fold: each is described once, and all interfaces derive from that description."""

from dataclasses import dataclass
from typing import Annotated, Any

import typer
from fastapi import Depends, FastAPI
from typer.testing import CliRunner

from docs import make_options
from foldback.cli.options import AsJson, takes
from foldback.planner.parameters.option import Choice, option, options_of
from foldback.planner.pipeline.request import FoldRequest
from foldback.server.dependencies.request_bodies import form_of
from foldback.server.pages.page import rendered
from foldback.server.store.schema import REQUESTED_COLUMNS, FoldRow
from tests.server.asgi import send_request


@dataclass(frozen=True, slots=True, kw_only=True)
class Extended(FoldRequest):
    """Request of a fold with one more option."""

    pace: str = option(
        "brisk",
        title="Pace of the fold",
        help="Pace: `brisk`, or `slow` for spectators.",
        label="Pace",
        choices={"brisk": Choice(label="Brisk"), "slow": Choice(label="Slow", note="a show")},
    )


def test_api_takes_a_new_option() -> None:
    app = FastAPI()

    @app.post("/folds")
    def post(expected: Annotated[Extended, Depends(form_of(Extended))]) -> dict[str, Any]:
        expected.check()
        return expected.to_json()

    del post
    (body,) = (
        schema for name, schema in app.openapi()["components"]["schemas"].items() if "post" in name
    )
    pace = body["properties"]["pace"]
    assert (pace["enum"], pace["default"], pace["title"]) == (["brisk", "slow"], "brisk", "Pace")
    assert pace["description"] == "Pace: `brisk`, or `slow` for spectators."
    answer = send_request(app, "/folds", method="POST", data={"pace": "slow", "start": "1,2,3"})
    assert Extended.from_json(answer.json()) == Extended(pace="slow", start=(1, 2, 3))
    assert send_request(app, "/folds", method="POST", data={"pace": "hasty"}).status_code == 422


def test_command_line_takes_a_new_option() -> None:
    fold_requests: list[FoldRequest] = []
    app = typer.Typer()

    @app.command()
    @takes(schema=Extended)
    def fold(*, request: FoldRequest, as_json: AsJson = False) -> None:
        fold_requests.append(request)

    del fold
    result = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "200", "TERM": "dumb"})
    assert "Pace of the fold: brisk or slow (a show)." in result.output
    changed = ("--preset=paper", "--set", "radial_gain=2", "--set", "damping=0.12, step_s=.01")
    result = CliRunner().invoke(app, ["--pace", "slow", "--seed", "7", "--repair", *changed])
    settings = "radial_gain=2,damping=0.12, step_s=.01"
    paper = Extended(pace="slow", seed=7, repair=True, preset="paper", settings=settings)
    assert (result.exit_code, fold_requests) == (0, [paper]), result.output
    result = CliRunner().invoke(app, ["--pace", "hasty"])
    assert result.exit_code == 2
    assert "got the pace 'hasty', expected one of: brisk, slow." in result.output


def test_client_docs_and_preview_page_have_each_option() -> None:
    assert '\n    pace: Literal["brisk", "slow"]\n' in make_options.client_types(Extended)
    row = "| `pace` | `brisk`, `slow` | `brisk` | Pace: `brisk`, or `slow` for spectators. |"
    assert row in make_options.page(make_options.PAGE.read_text(encoding="utf-8"), Extended)
    facts = {"name": "Cup", "most_modules": 100, "origin": {}}
    html = rendered("preview.html", facts=facts, facts_json="{}", options=options_of(Extended))
    _, _, extra = html.partition('id="more-options"')  # the script sends all fields of this form
    control, _, _ = extra.partition("</div>")
    assert '<select id="pace" name="pace"><option value="brisk">Brisk</option>' in control
    for form_option in options_of(FoldRequest).values():
        for value, choice in form_option.choices.items() if form_option.label else ():
            assert f'value="{value}"' in html
            assert choice.label in html


def test_client_and_docs_are_up_to_date() -> None:
    page = make_options.PAGE.read_text(encoding="utf-8")
    assert make_options.page(page) == page
    assert make_options.client_types() == make_options.CLIENT.read_text(encoding="utf-8")


def test_request_survives_json() -> None:
    request = FoldRequest(filename="a.stl", start=(1, 2, 3), modules=64, refold=True)
    assert FoldRequest.from_json(request.to_json()) == request
    older = {"filename": "a.stl", "preset": "paper", "unknown": 1}
    assert FoldRequest.from_json(older) == FoldRequest(filename="a.stl", preset="paper")


def test_requested_columns_are_options() -> None:
    assert set(REQUESTED_COLUMNS) <= set(options_of(FoldRequest))
    assert set(REQUESTED_COLUMNS) <= set(FoldRow.__table__.columns.keys())
