"""Message before the first test if Chromium or PostgreSQL is missing."""

import os

import pytest

from tests import tools
from tests.tools import MissingToolError, Tool


@pytest.fixture
def not_root(monkeypatch: pytest.MonkeyPatch) -> None:
    """Run as another user than root, so that no package can be installed."""
    monkeypatch.setattr(os, "geteuid", lambda: 1000)


@pytest.mark.usefixtures("not_root")
def test_missing_tools_are_named_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    missing = [Tool(name, (name.lower(),), lambda: None) for name in ("Chromium", "PostgreSQL")]
    monkeypatch.setattr(tools, "TOOLS", (*missing, Tool("sh", ("dash",), lambda: "/bin/sh")))
    with pytest.raises(SystemExit) as exit:
        tools.main()
    assert exit.value.code == (
        "Missing for the tests: Chromium, PostgreSQL. Run `sudo apt-get install chromium "
        "postgresql`; all that needs none of them is run by `make test-fast`."
    )
    with pytest.raises(MissingToolError, match="apt-get install chromium`"):
        missing[0].get()


@pytest.mark.usefixtures("not_root")
def test_tool_is_downloaded_once(capsys: pytest.CaptureFixture[str]) -> None:
    got: list[str] = []
    tool = Tool("Chromium", (), lambda: got[0] if got else None, lambda: got.append("/got"))
    assert tool.get() == tool.get() == "/got"
    assert got == ["/got"]
    assert capsys.readouterr().err == "Downloading Chromium, once …\n"
