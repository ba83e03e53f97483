"""Page that follows a fold through the code: its signatures are those of the functions."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "how-a-fold-is-computed.md"
STEP = re.compile(r"^`(planner/[\w/]+\.py)`\n\n```python\n(.*?)\n```", re.MULTILINE | re.DOTALL)
STEPS = STEP.findall(PAGE.read_text())


def headers(source: str) -> dict[str, str]:
    """Return the header of each function of a source on one line, by its name."""
    page_signatures: dict[str, str] = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef):
            node.body, node.decorator_list = [ast.Pass()], []
            page_signatures[node.name] = ast.unparse(node)
    return page_signatures


def test_page_has_ten_steps() -> None:
    assert len(STEPS) == 10


@pytest.mark.parametrize(("file", "shown_signature"), STEPS, ids=[file for file, _ in STEPS])
def test_signature_on_the_page_is_that_of_the_function(file: str, shown_signature: str) -> None:
    ((name, header),) = headers(f"{shown_signature}: ...").items()
    assert header == headers((ROOT / file).read_text())[name]
