"""deploy/compose.yaml: valid according to the compose specification, and set up as intended."""

import ipaddress
import os
import re
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import psycopg
import pytest
import yaml
from compose_spec import PyCompose

from tests.deploy.files import DEPLOY, compose, variables
from tests.server.postgres import Postgres
from tests.tools import POSTGRES

TEXT = (DEPLOY / "compose.yaml").read_text()
ENVIRONMENT = variables()
COMPOSE = compose(ENVIRONMENT)
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]


def stripped() -> dict[str, Any]:
    """Return the file without extension fields, whose anchors are merged already."""
    return {name: value for name, value in COMPOSE.items() if not name.startswith("x-")}


def test_compose_file_is_valid_and_wrong_ones_are_found() -> None:
    composed = PyCompose.from_yaml(yaml.safe_dump(stripped()))
    composed.validate()
    names = {"proxy", "web", "worker", "database", "storage", "prometheus"}
    assert set(composed.service_names()) == names
    assert [name for name in names if "profiles" in SERVICES[name]] == ["prometheus"]

    web = {**SERVICES["web"], "networks": ["nowhere"]}
    broken = {**stripped(), "services": {**SERVICES, "web": web}}
    with pytest.raises(Exception, match=r"\w"):
        PyCompose.from_yaml(yaml.safe_dump(broken)).validate()


def test_volumes_services_and_files_that_are_named_exist() -> None:
    for service in SERVICES.values():
        named = {v.partition(":")[0] for v in service.get("volumes", []) if ":" in v}
        assert {name for name in named if name[0] != "."} <= set(COMPOSE["volumes"])
        assert set(service.get("depends_on", {})) <= set(SERVICES)
    binds = [v for s in SERVICES.values() for v in s.get("volumes", []) if v.startswith(".")]
    assert binds and all((DEPLOY / v.partition(":")[0]).is_file() for v in binds)
    build = SERVICES["web"]["build"]
    assert (DEPLOY / build["context"] / build["dockerfile"]).resolve() == DEPLOY / "Dockerfile"


def test_variables_are_those_of_the_example() -> None:
    assert set(re.findall(r"\$\{([A-Z0-9_]+)", TEXT)) == set(ENVIRONMENT)
    assert {name for name, value in ENVIRONMENT.items() if value == "change-me"} == {
        "POSTGRES_PASSWORD",
        "S3_SECRET_KEY",
    }


@pytest.mark.parametrize("name", SERVICES)
def test_every_container_is_confined_and_has_a_health_check(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service.get("cap_add", []) == (["NET_BIND_SERVICE"] if name == "proxy" else [])
    assert "no-new-privileges:true" in service["security_opt"]
    assert service["restart"] == "unless-stopped"
    assert {"cpus", "memory", "pids"} <= set(service["deploy"]["resources"]["limits"])
    assert ("ports" in service) == (name == "proxy")
    assert "privileged" not in service
    # The tag of an image is a fixed version, not the latest one.
    assert re.search(r":[\w.-]+$", service["image"]) and ":latest" not in service["image"]
    check = service.get("healthcheck")
    if name == "web":  # foldback's image has its own health check
        assert check is None and "HEALTHCHECK" in (DEPLOY / "Dockerfile").read_text()
    else:
        assert check == {"disable": True} if name == "worker" else check["test"][0] == "CMD"


def test_only_the_proxy_reaches_the_internet() -> None:
    inner = {name for name, network in COMPOSE["networks"].items() if network}
    assert all(COMPOSE["networks"][name]["internal"] for name in inner)
    for name, service in SERVICES.items():
        assert (set(service["networks"]) <= inner) == (name != "proxy")
    assert not set(SERVICES["proxy"]["networks"]) & set(SERVICES["database"]["networks"])


def test_only_the_proxy_is_trusted_for_addresses() -> None:
    front = COMPOSE["networks"]["front"]["ipam"]["config"][0]
    address = SERVICES["proxy"]["networks"]["front"]["ipv4_address"]
    assert SERVICES["web"]["environment"]["FOLDBACK_TRUSTED_PROXIES"] == address
    assert ipaddress.ip_address(address) in ipaddress.ip_network(front["subnet"])
    # Docker's own address range for containers ends before it.
    assert ipaddress.ip_address(address) not in ipaddress.ip_network(front["ip_range"])
    moved = compose({**ENVIRONMENT, "FRONT_NETWORK": "10.9.8"})
    assert "172.30.90" not in yaml.safe_dump(moved)
    web, proxy = moved["services"]["web"], moved["services"]["proxy"]
    assert web["environment"]["FOLDBACK_TRUSTED_PROXIES"] == "10.9.8.2"
    assert proxy["networks"]["front"]["ipv4_address"] == "10.9.8.2"
    assert moved["networks"]["front"]["ipam"]["config"][0]["subnet"] == "10.9.8.0/24"


def test_metrics_are_open_inside_and_closed_outside() -> None:
    assert SERVICES["web"]["environment"]["FOLDBACK_METRICS_PUBLIC"] == "true"
    assert re.search(r"@operators path /metrics ", (DEPLOY / "Caddyfile").read_text())
    prometheus = yaml.safe_load((DEPLOY / "prometheus.yml").read_text())
    (job,) = prometheus["scrape_configs"]
    assert job["dns_sd_configs"][0]["names"] == ["web"] and "web" in SERVICES
    assert SERVICES["prometheus"]["networks"] == ["front"]
    mounted = {v.split(":")[1] for v in SERVICES["prometheus"]["volumes"] if v[0] == "."}
    assert {f"/etc/prometheus/{name}" for name in prometheus["rule_files"]} < mounted


@pytest.mark.processes
def test_role_of_the_service_is_no_superuser() -> None:
    database = SERVICES["database"]
    assert set(database["environment"]) == {"POSTGRES_PASSWORD"}  # the superuser is `postgres`
    (script,) = [v.split(":") for v in database["volumes"] if "/docker-entrypoint-initdb.d/" in v]
    url = SERVICES["web"]["environment"]["FOLDBACK_DATABASE_URL"]
    secret = 'it\'s "secret"'
    with closing(Postgres("postgres")) as postgres:
        postgres.start()
        environment = {
            **{"PATH": f"{Path(POSTGRES.get())}:{os.environ['PATH']}", "PGHOST": "127.0.0.1"},
            **{"PGPORT": str(postgres.port), "POSTGRES_PASSWORD": secret},
        }
        subprocess.run(["sh", DEPLOY / script[0]], env=environment, check=True, timeout=60)
        user, name = urlsplit(url).username, urlsplit(url).path[1:]
        assert user and urlsplit(url).password == ENVIRONMENT["POSTGRES_PASSWORD"]
        with psycopg.connect(postgres.url("postgres")) as connection:
            roles = connection.execute(
                "SELECT rolname, rolsuper, rolcreaterole, rolcreatedb, rolpassword IS NULL "
                "FROM pg_authid WHERE rolcanlogin ORDER BY rolname"
            ).fetchall()
        assert roles == [
            (user, False, False, False, False),
            ("postgres", True, True, True, True),
        ]
        with psycopg.connect(postgres.url(name).replace("postgres@", f"{user}@")) as connection:
            connection.execute("CREATE TABLE folds (id text)")
            with pytest.raises(psycopg.errors.InsufficientPrivilege):
                connection.execute("COPY folds FROM PROGRAM 'echo evil'")


def test_times_and_sizes_fit_together() -> None:
    worker = SERVICES["worker"]
    grace = int(worker["stop_grace_period"].removesuffix("s"))
    assert grace >= int(worker["environment"]["FOLDBACK_DRAIN_S"]) + 15
    body = int(ENVIRONMENT["MAX_BODY"].removesuffix("MiB")) * 2**20
    upload = int(ENVIRONMENT["FOLDBACK_MAX_UPLOAD_BYTES"])
    assert upload + 64 * 1024 <= body <= 1.1 * upload
    assert "MAX_BODY:65MiB" in (DEPLOY / "Caddyfile").read_text()
