"""Pages of shipped folds, in a process without workers."""

from pathlib import Path

import pytest

from foldback.server.submission.shipped_folds import SHIPPED_FOLDS_DIR
from tests.run_python import run_python

PROGRAM = """
import sys
from pathlib import Path

from fastapi.testclient import TestClient
from foldback.server.submission import shipped_folds
from foldback.server.app import create_app
from foldback.server.cli.serve import _fold_first
from foldback.server.settings import Settings
from tests.server import routes

shipped_folds.SHIPPED_FOLDS_DIR = Path(sys.argv[2])
app = create_app(Settings(data_dir=sys.argv[1], workers=0, prewarm=False))
with TestClient(app, base_url="http://127.0.0.1:8000") as client:
    context = app.state.context
    first = _fold_first(context, "wrench-160")
    assert context.store.fold(first).status == "verified" and not context.store.waiting()
    pages = [page for page in routes.pages() if page != "/compare"]  # which needs two folds
    pages += ["/featured/bundle", "/featured/batch", "/featured/picture.png"]
    pages += ["/shapes/cat.svg", "/shapes/tetra-ring.svg", "/shapes/cat/motion.svg"]
    for row in context.store.list_public():
        page, api = f"/folds/{row.id}", f"/api/folds/{row.id}"
        assert "Included with foldback, computed with version" in client.get(page).text
        pages += [page, f"{page}/facts", f"{page}/drawing.svg", f"{page}/motion.svg", api]
        pages += [f"{page}/bundle", f"{page}/batch?from=0&to=50", f"{page}/figures"]
        pages += [f"{api}/frames?to=5&poses=true"]
        pages += [f"{api}/plan.json", f"{api}/plan.npz", f"{api}/exports"]
        if row.modules < 100:  # what is made for the occasion takes seconds for the longest chain
            pages += [f"{api}/model.xml", f"{page}/standalone.html"]
    for page in pages:
        assert client.get(page).status_code == 200, page
    assert f'href="/folds/{first}"' in client.get("/").text
"""


@pytest.mark.processes
@pytest.mark.slow
def test_pages_of_shipped_folds_are_answered(tmp_path: Path) -> None:
    folds = tmp_path / "finished"
    folds.mkdir()
    for name in ("tetra-cube-2", "wrench-160", "wrench-80-to-mallet-80"):  # one of each kind
        (folds / f"{name}.fold").symlink_to(SHIPPED_FOLDS_DIR / f"{name}.fold")
    run_python("-W", "ignore", "-c", PROGRAM, str(tmp_path / "data"), str(folds))
