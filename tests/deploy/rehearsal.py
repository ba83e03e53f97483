"""Run all of deploy/compose.yaml without containers, and test the result.

Run by ``make compose-check``, as root on Linux. Each service is a process in a network namespace of
its own, with the networks, names, addresses and environment that the file and the Dockerfile set;
only the path of the data differs. PostgreSQL and Caddy are those of this machine; moto
replaces the S3 store, and a hosts file replaces Docker's name server. Nothing of it is visible
outside: all namespaces end with this process.
"""

import os
import re
import secrets
import shutil
import signal
import ssl
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import httpx

from foldback.client import Client
from tests.deploy.files import DEPLOY, check, compose, variables
from tests.server.service_process import SNAKE, wait_until
from tests.tools import CADDY, POSTGRES

ROOT = DEPLOY.parent
SITE = "fold.localhost"
NETWORKS = {"back": "10.77.0", "outside": "10.78.0"}
"""First three numbers of the networks' addresses, which Docker would choose itself."""
FIRST_HOST = {"database": 2, "storage": 3, "proxy": 2, "web": 129, "worker": 150}
"""Last number of the address of each service's first replica; the others follow."""
TIMEOUT_S = 120.0
FOLDBACK = (sys.executable, "-P", "-m", "foldback.server.cli.command_line")


def run(*command: object, **arguments: Any) -> str:
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, check=False, **arguments
    )
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
    return done.stdout


def ip(arguments: str) -> None:
    run("ip", *arguments.split())


def wait_for(event_name: str, condition: Callable[[], bool]) -> None:
    wait_until(condition, lambda: event_name, (httpx.TransportError, AssertionError, OSError))
    check(event_name, True)


class Services:
    """Services of the file, each process in a network namespace of its own.

    Args:
        place: Directory for data and logs.
    """

    def __init__(self, place: Path) -> None:
        self.place = place
        secret = {name: secrets.token_hex(32) for name in ("POSTGRES_PASSWORD", "S3_SECRET_KEY")}
        self.file = compose({**variables(), **secret, "SITE": SITE})
        front = self.file["networks"]["front"]["ipam"]["config"][0]["subnet"]
        self.networks = {**NETWORKS, "front": front.rpartition(".")[0]}
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        text = (DEPLOY / "Dockerfile").read_text().rpartition("FROM ")[2]
        (block,) = re.findall(r"^ENV ((?:.*\\\n)*.*)", text, re.MULTILINE)
        self.image = dict(word.split("=", 1) for word in block.replace("\\\n", " ").split())

    def replicas(self, service: str) -> list[str]:
        count = self.file["services"][service].get("deploy", {}).get("replicas", 1)
        return [f"{service}-{n}" for n in range(int(count))]

    def address(self, replica: str, network: str) -> str:
        service, _, n = replica.rpartition("-")
        fixed = self.file["services"][service]["networks"]
        fixed_ip = (fixed[network] or {}).get("ipv4_address") if isinstance(fixed, dict) else None
        return fixed_ip or f"{self.networks[network]}.{FIRST_HOST[service] + int(n)}"

    def connect(self) -> None:
        """Create networks, namespaces and host names."""
        Path("/run/netns").mkdir(exist_ok=True)
        run("mount", "-t", "tmpfs", "tmpfs", "/run/netns")
        for network, first in self.networks.items():
            ip(f"link add {network} type bridge")
            ip(f"addr add {first}.1/24 dev {network}")
            ip(f"link set {network} up")
        names = ["127.0.0.1 localhost", f"{self.networks['outside']}.2 {SITE}"]
        for service in ("database", "storage", "web", "worker", "proxy"):
            for replica in self.replicas(service):
                ip(f"netns add {replica}")
                ip(f"-n {replica} link set lo up")
                for n, network in enumerate(self.file["services"][service]["networks"]):
                    inner, outer = f"eth{n}", f"{replica}.{n}"
                    ip(f"link add {outer} type veth peer name {inner} netns {replica}")
                    ip(f"link set {outer} master {network} up")
                    address = self.address(replica, network)
                    ip(f"-n {replica} addr add {address}/24 dev {inner}")
                    ip(f"-n {replica} link set {inner} up")
                    expected = "front" if service == "web" else "back"
                    if network == expected and service != "proxy":
                        names.append(f"{address} {service}")
        hosts = self.place / "hosts"
        hosts.write_text("\n".join(names) + "\n")
        run("mount", "--bind", hosts, "/etc/hosts")

    def environment(self, service: str) -> dict[str, str]:
        given_environment = self.file["services"][service].get("environment", {})
        # compose replaces variables after it has parsed the YAML: every value is a text.
        texts = {
            name: "" if value is None else str(value) for name, value in given_environment.items()
        }
        return {"PATH": os.environ["PATH"], "HOME": str(self.place), **texts}

    def foldback_env(self, replica: str) -> dict[str, str]:
        """Return the environment of image and file, with a data directory of this machine."""
        image = {k: v for k, v in self.image.items() if k != "PATH"}
        data = {"FOLDBACK_DATA_DIR": str(self.place / f"data-{replica}")}
        named = self.environment(replica.rpartition("-")[0])
        return {**image, **named, **data, "PYTHONPATH": str(ROOT)}

    def inside(self, replica: str, *command: object) -> list[str]:
        return ["nsenter", f"--net=/run/netns/{replica}", *(str(part) for part in command)]

    def start(self, replica: str, environment: Mapping[str, str], *command: object) -> None:
        with open(self.place / f"{replica}.log", "ab") as log:
            self.processes[replica] = subprocess.Popen(
                self.inside(replica, *command),
                env=dict(environment),
                cwd=self.place,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def start_foldback(self) -> None:
        for service in ("web", "worker"):
            (command,) = self.file["services"][service]["command"]
            for replica in self.replicas(service):
                self.start(replica, self.foldback_env(replica), *FOLDBACK, command)

    def stop_foldback(self) -> None:
        self.stop(*(name for name in self.processes if name.startswith(("web", "worker"))))

    def admin(self, *arguments: object) -> subprocess.CompletedProcess[str]:
        """Run the equivalent of `docker compose run --rm worker admin …`."""
        return subprocess.run(
            self.inside("worker-0", *FOLDBACK, "admin", *arguments),
            env=self.foldback_env("worker-0"),
            cwd=self.place,
            capture_output=True,
            text=True,
            check=False,
        )

    def stop(self, *replicas: str) -> None:
        for replica in replicas:
            # On SIGTERM PostgreSQL would wait for its clients.
            number = signal.SIGINT if replica.startswith("database") else signal.SIGTERM
            self.processes[replica].send_signal(number)
        for replica in replicas:
            self.processes.pop(replica).wait(TIMEOUT_S)


def start_database(services: Services) -> None:
    programs = Path(POSTGRES.get())
    environment = services.environment("database")
    home = services.place / "database"
    home.mkdir()
    (home / "password").write_text(environment["POSTGRES_PASSWORD"])
    shutil.chown(home, "postgres", "postgres")
    shutil.chown(home / "password", "postgres", "postgres")
    as_postgres = ("setpriv", "--reuid=postgres", "--regid=postgres", "--clear-groups")
    secret = ("--username", "postgres", "--pwfile", home / "password")
    run(
        *(*as_postgres, programs / "initdb", "--pgdata", home / "cluster", *secret),
        *("--auth=scram-sha-256", "--no-sync", "--no-instructions"),
        cwd=home,
    )
    with open(home / "cluster" / "pg_hba.conf", "a") as file:
        file.write("host all all all scram-sha-256\n")
    _, *options = services.file["services"]["database"]["command"]
    server_options = ("-D", home / "cluster", "-h", "*", "-k", home, *options)
    services.start("database-0", environment, *as_postgres, programs / "postgres", *server_options)
    _, *health_check = services.file["services"]["database"]["healthcheck"]["test"]
    wait_for(
        "its own health check finds the database well",
        lambda: not subprocess.call(services.inside("database-0", *health_check), env=environment),
    )
    # As the image does it: over the socket, before the first connection from outside.
    (script,) = [
        DEPLOY / volume.partition(":")[0]
        for volume in services.file["services"]["database"]["volumes"]
        if volume.endswith(".sh:ro")
    ]
    socket = {**environment, "PATH": f"{programs}:{environment['PATH']}", "PGHOST": str(home)}
    run(*as_postgres, "sh", script, env={**socket, "PGPASSWORD": environment["POSTGRES_PASSWORD"]})


def start_storage(services: Services) -> None:
    environment = services.environment("storage")
    port = environment["VGW_PORT"].removeprefix(":")
    moto = (sys.executable, "-P", "-m", "moto.server", "-H", "0.0.0.0", "-p", port)
    services.start("storage-0", environment, *moto)
    make_bucket = f"http://storage:{port}/foldback"
    wait_for("the store has a bucket", lambda: httpx.put(make_bucket, timeout=9).is_success)


def start_proxy(services: Services) -> ssl.SSLContext:
    own_directories = {"XDG_DATA_HOME": str(services.place), "XDG_CONFIG_HOME": str(services.place)}
    config = ("--config", DEPLOY / "Caddyfile", "--adapter", "caddyfile")
    services.start(
        "proxy-0", services.environment("proxy") | own_directories, CADDY.get(), "run", *config
    )
    root = services.place / "caddy" / "pki" / "authorities" / "local" / "root.crt"
    wait_for("the proxy has a certificate", root.is_file)
    return ssl.create_default_context(cafile=str(root))


def try_out(services: Services, trusts: ssl.SSLContext) -> None:
    """Fold through the proxy, and check which ports and routes are open."""
    address = f"https://{SITE}"
    webs = [services.address(replica, "front") for replica in services.replicas("web")]
    http = httpx.Client(base_url=address, verify=trusts, timeout=30)
    wait_for("a page comes over TLS", lambda: http.get("/").is_success)
    for web in webs:
        inner = f"http://{web}:8000"
        wait_for(f"{web} is ready", lambda inner=inner: httpx.get(f"{inner}/ready").is_success)
        figures = httpx.get(f"{inner}/metrics").text
        check(f"{web} tells its metrics inside", "foldback_storage_up 1.0" in figures)
        every = f"foldback_workers {len(services.replicas('worker'))}.0"
        wait_for(
            f"{web} knows all workers",
            lambda inner=inner, every=every: every in httpx.get(f"{inner}/metrics").text,
        )
    for path in ("/metrics", "/ready", "/metrics/", "/METRICS"):
        refused = http.get(path)
        check(f"{path} is closed outside", "foldback_" not in refused.text and refused.is_error)
    for host, port in ((services.address("database-0", "back"), 5432), ("web", 8000)):
        code = f"import socket; socket.create_connection(({host!r}, {port}), 3)"
        failed = subprocess.call(
            services.inside("proxy-0", sys.executable, "-c", code), stderr=subprocess.DEVNULL
        )
        check(f"the proxy reaches port {port}: {port == 8000}", (failed == 0) == (port == 8000))
    with Client(address, verify=trusts) as client:
        fold = client.fold(SNAKE, seed=1)
        wait_for("it folds", lambda: client.get(fold.id).status == "verified")
        page, plan = f"/folds/{fold.id}", f"/api/folds/{fold.id}/plan.json"
        before = http.get(plan).content
        check("its page and its plan are there", http.get(page).is_success and len(before) > 100)
        services.stop("web-0")
        wait_for("one web process is enough", lambda: http.get(page).is_success)
        back_up_and_restore(services)
        wait_for("the fold is there again", lambda: http.get(page).is_success)
        check("its plan is the same", http.get(plan).content == before)
        second_fold = client.fold(SNAKE, seed=2)
        wait_for("it folds again", lambda: client.get(second_fold.id).status == "verified")


def back_up_and_restore(services: Services) -> None:
    """Back up the running service, delete all data, and restore them."""
    copy = services.place / "backup"
    done = services.admin("backup", copy)
    check(f"a backup is made: {done.stdout.strip()}{done.stderr}", done.returncode == 0)
    check("a running service is not overwritten", services.admin("restore", copy).returncode == 1)
    refused = services.admin("restore", "--replace", copy)
    check("not even when told", refused.returncode == 1 and "in use" in refused.stderr)
    services.stop_foldback()
    services.stop("storage-0")  # moto stores everything in memory
    start_storage(services)
    for data in services.place.glob("data-*"):
        shutil.rmtree(data)
    done = services.admin("restore", "--replace", copy)
    check(f"it is restored: {done.stdout.strip()}{done.stderr}", done.returncode == 0)
    check("no table is old", services.admin("migrate", "--check").returncode == 0)
    services.start_foldback()


def rehearse() -> None:
    run("mount", "--make-rprivate", "/")
    ip("link set lo up")
    with tempfile.TemporaryDirectory(prefix="foldback-rehearsal-", dir="/tmp") as place:
        services = Services(Path(place))
        Path(place).chmod(0o755)
        try:
            services.connect()
            start_database(services)
            start_storage(services)
            services.start_foldback()
            try_out(services, start_proxy(services))
        except BaseException:
            for log in Path(place).glob("*.log"):
                print(f"--- {log.name}\n" + "\n".join(log.read_text().splitlines()[-15:]))
            raise
        finally:
            services.stop_foldback()  # workers need the others to requeue
            services.stop(*services.processes)


def main() -> None:
    if sys.argv[1:] == ["--inside"]:
        rehearse()
        return
    if os.geteuid() != 0 or not all(map(shutil.which, ("unshare", "nsenter", "setpriv", "ip"))):
        sys.exit("This needs root on Linux, with util-linux and iproute2.")
    command = ["unshare", "--net", "--mount", sys.executable, "-m", "tests.deploy.rehearsal"]
    sys.exit(subprocess.call([*command, "--inside"], cwd=ROOT))


if __name__ == "__main__":
    main()
