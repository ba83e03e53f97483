"""Settings: how they are read, and the errors of invalid ones."""

import logging
import sys
from pathlib import Path

import pytest
from pydantic import ValidationError

from foldback.server.doctor import machine
from foldback.server.doctor.doctor import examined
from foldback.server.ops.startup_errors import settings_of, warn_of_unknown_names
from foldback.server.settings import Settings
from tests.server.cli.test_command_line import foldback


def test_lists_are_read_from_commas_or_json(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("origins", "embed_origins", "allowed_hosts", "trusted_proxies"):
        proxies = name == "trusted_proxies"
        values = ("127.0.0.1", "::1") if proxies else ("https://a.org", "http://b:8")
        texts = [" , ".join(values), f'["{values[0]}", "{values[1]}"]']
        if "origins" in name:
            texts.append("https://a.org/, http://b:8")
        for text in texts:
            monkeypatch.setenv(f"FOLDBACK_{name.upper()}", text)
            assert getattr(Settings(), name) == values


def test_database_addresses_may_have_any_password(monkeypatch: pytest.MonkeyPatch) -> None:
    for url in (
        "postgresql://us:a#b?c[d/e@db/x",
        "postgres:///x?host=/run/postgresql",
        "postgresql+psycopg://us@[::1]:5432/x",
        "sqlite:////data/x.db",
    ):
        monkeypatch.setenv("FOLDBACK_DATABASE_URL", url)
        assert Settings().database_url == url


def test_postgresql_without_its_driver_is_refused_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(ValidationError, match=r"pip install 'foldback\[storage\]'"):
        Settings(database_url="postgresql://us:secret@db/x")
    assert Settings(database_url="sqlite:////data/x.db").database_url


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("ORIGINS", "example.org", "got 'example.org', expected a scheme and a host"),
        ("ORIGINS", "[https://a.org", "got '[https://a.org', expected names separated by commas"),
        ("EMBED_ORIGINS", "https://a.org; script-src *", "expected a scheme and a host"),
        ("TRUSTED_PROXIES", "proxy", "got 'proxy', expected an address or a network"),
        ("PORT", "eighty", "got 'eighty', expected a whole number"),
        ("PORT", "65536", "got '65536', expected at most 65535"),
        ("MAX_UPLOAD_BYTES", "67108865", "got '67108865', expected at most 67108864"),
        ("LEASE_S", "0", "got '0', expected more than 0"),
        ("LEASE_S", "soon", "got 'soon', expected a number"),
        ("STAGE_CPU_SECONDS", "inf", "got 'inf', expected a finite number"),
        ("METRICS_PUBLIC", "perhaps", "got 'perhaps', expected true or false"),
        ("LOG_FORMAT", "xml", "got 'xml', expected 'text' or 'json'"),
        ("LOG_LEVEL", "loud", "got 'loud', expected 'debug', 'info', 'warning' or 'error'"),
        ("STORAGE_BYTES", "", "got '', expected a whole number"),
        ("DATABASE_URL", "mysql://us:secret@db/x", "expected an address like postgresql://"),
        ("DATABASE_URL", "postgresql://us:secret@db:port/x", "expected an address like"),
    ],
)
def test_bad_value_is_reported_in_a_line(
    name: str,
    value: str,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv(f"FOLDBACK_{name}", value)
    with pytest.raises(SystemExit) as ended:
        settings_of()
    assert ended.value.code == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"FOLDBACK_{name}: got ")
    assert words in line and "unset it" in line and "secret" not in line
    (finding,) = examined({})
    assert (finding.name, finding.verdict) == ("settings", "problem")
    assert words in finding.finding and finding.remedy


@pytest.mark.usefixtures("process_state")
@pytest.mark.parametrize(
    "command", [["serve"], ["worker"], ["doctor"], ["admin", "list"], ["serve", "--port", "70000"]]
)
def test_every_command_reports_bad_settings(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FOLDBACK_DATA_DIR", str(tmp_path))
    monkeypatch.setenv("FOLDBACK_TRUSTED_PROXIES", "proxy")
    done = foldback(*command)
    assert done.returncode == 1
    output = done.stdout + done.stderr
    assert "got 'proxy', expected an address or a network" in output
    assert len(output.splitlines()) == 1
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("without_settings")
def test_unknown_setting_is_reported_with_a_suggestion(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("foldback_port", "8001")  # in any case
    assert machine.variables(Settings()).verdict == "ok"
    monkeypatch.setenv("FOLDBACK_ORIGIN", "https://a.org")
    with caplog.at_level(logging.WARNING):
        warn_of_unknown_names(logging.getLogger("foldback"))
    words = "FOLDBACK_ORIGIN is not a setting and is ignored; did you mean FOLDBACK_ORIGINS?"
    assert caplog.messages == [words]
    variables = machine.variables(Settings())
    assert (variables.verdict, variables.finding) == ("warning", words)
    assert variables.remedy


def test_computing_processes_step_back_on_public_services_only() -> None:
    for host, niceness in (("127.0.0.1", 0), ("127.0.0.5", 0), ("::1", 0), ("0.0.0.0", 19)):
        assert Settings(host=host).child_niceness == niceness
    assert (
        Settings(niceness=7).child_niceness == Settings(host="::", niceness=7).child_niceness == 7
    )
