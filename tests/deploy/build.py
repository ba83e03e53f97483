"""Build deploy/Dockerfile and test the image, without a container daemon.

Run by ``make deploy-check``, as root on a Debian; it takes minutes and some gigabytes. The base
image is made by debootstrap instead of being fetched from a registry: Debian's own Python 3.11,
nothing else. buildah runs every step; the service is then started as the image's user.
"""

import argparse
import json
import os
import re
import secrets
import shutil
import ssl
import subprocess
import sys
import urllib.request
from pathlib import Path

from tests.deploy.files import DEPLOY, check
from tests.server.service_process import wait_until

ROOT = DEPLOY.parent
BASE_IMAGE = "docker.io/library/python:3.11-slim-bookworm"
PACKAGES = ("buildah", "debootstrap", "crun")
BASE_PACKAGES = ("ca-certificates", "python3", "python3-venv", "python3-pip", "python3-dev")
MIRROR = "http://deb.debian.org/debian"
PORT = 8765
TIMEOUT_S = 180.0
CERTIFICATES = "/etc/ssl/certs/ca-certificates.crt"


class Builder:
    """Runner of buildah, with a store of its own."""

    def __init__(self, place: Path) -> None:
        self._place = place
        configuration = place / "storage.conf"
        configuration.write_text(
            f'[storage]\ndriver = "vfs"\ngraphroot = "{place}/graph"\nrunroot = "{place}/run"\n'
        )
        self._environment = {
            **os.environ,
            "CONTAINERS_STORAGE_CONF": str(configuration),
            "BUILDAH_ISOLATION": "chroot",
        }

    def __call__(self, *arguments: str) -> str:
        """Run a command of buildah and return its output."""
        command = ["buildah", *arguments]
        done = subprocess.run(
            command, env=self._environment, stdout=subprocess.PIPE, text=True, check=True
        )
        return done.stdout.strip()

    def start(self, *arguments: str) -> subprocess.Popen[str]:
        """Start a command of buildah that keeps running."""
        return subprocess.Popen(["buildah", *arguments], env=self._environment, text=True)


def make_base_image(builder: Builder, place: Path) -> None:
    """Make the base image."""
    root = place / "base"
    if not (root / "usr/bin/python3").exists():
        shutil.rmtree(root, ignore_errors=True)
        expected = f"--include={','.join(BASE_PACKAGES)}"
        command = ["debootstrap", "--variant=minbase", expected, "bookworm", str(root), MIRROR]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    # The build trusts this machine's certificates, because some networks have their own.
    trusted = os.environ.get("SSL_CERT_FILE") or ssl.get_default_verify_paths().cafile
    shutil.copyfile(trusted or CERTIFICATES, root / CERTIFICATES[1:])
    container = builder("from", "scratch")
    builder("add", "--quiet", container, str(root), "/")
    paths = "PATH=/usr/local/bin:/usr/bin:/bin:/usr/sbin:/sbin"
    builder("config", "--env", paths, "--env", f"PIP_CERT={CERTIFICATES}", container)
    builder("commit", "--quiet", "--rm", container, BASE_IMAGE)


def build(builder: Builder) -> None:
    """Run every step of the Dockerfile."""
    dockerfile = str(ROOT / "deploy" / "Dockerfile")
    builder(
        *("bud", "--network=host", "--pull-never", "--format=docker"),
        *("--file", dockerfile, "--tag", "foldback:local", str(ROOT)),
    )


def try_out(builder: Builder) -> None:
    """Check the image's configuration, fold with it, and start the service in it."""
    about = json.loads(builder("inspect", "--type=image", "foldback:local"))
    config = about["Docker"]["config"]
    check("it runs as a user of its own", config["User"] == "10001:10001")
    check("it starts the service", config["Entrypoint"] + config["Cmd"] == ["foldback", "serve"])
    check("it says whether it is well", "/health" in str(config["Healthcheck"]["Test"]))
    container = builder("from", "--pull-never", "foldback:local")
    try:
        owner_ids = builder("run", container, "--", "id", "-u")
        check("that user is who it is", owner_ids == "10001")
        can = "test -w /data && ! test -w /opt/foldback && ! test -w /etc && echo yes"
        check(
            "it may write its data alone", builder("run", container, "--", "sh", "-c", can) == "yes"
        )
        command = "foldback fold box-4x4x4 --out /data/out --json | tail -1"
        plan = json.loads(builder("run", container, "--", "sh", "-c", command))
        check("it folds", plan["status"] == "verified")
        make = "foldback movie /data/out --out /data/film.gif --seconds 1"
        film = f"{make} --width 160 --height 120 && head -c 3 /data/film.gif"
        check("it films", builder("run", container, "--", "sh", "-c", film).endswith("GIF"))
        serve(builder, container)
    finally:
        builder("rm", container)


def serve(builder: Builder, container: str) -> None:
    """Start the service as the image does, and request its status and run its health check."""
    name = secrets.token_hex(4)
    environment = f"FOLDBACK_PORT={PORT} FOLDBACK_DATA_DIR=/data/{name} FOLDBACK_WORKERS=0"
    line = f"{environment} foldback serve & echo $! > /data/{name}.pid; wait"
    process = builder.start("run", "--network=host", container, "--", "sh", "-c", line)
    try:
        health = f"http://127.0.0.1:{PORT}/health"
        wait_until(lambda: urllib.request.urlopen(health), errors=(OSError,))
        with urllib.request.urlopen(health) as answer:
            check("it serves", json.load(answer) == {"status": "ok"})
        test = re.search(r'CMD \["python3", "-c", "(.*)"\]', dockerfile_text())
        code = f"import os; os.environ['FOLDBACK_PORT'] = '{PORT}'; {test[1]}"
        builder("run", "--network=host", container, "--", "python3", "-c", code)
        check("its health check says so", True)
    finally:
        builder("run", container, "--", "sh", "-c", f"kill $(cat /data/{name}.pid)")
        process.wait(TIMEOUT_S)


def dockerfile_text() -> str:
    return (ROOT / "deploy" / "Dockerfile").read_text()


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--place", type=Path, default=Path("/var/tmp/foldback-build"))
    options.add_argument("--keep", action="store_true", help="Keep base and images.")
    parsed = options.parse_args()
    if os.geteuid() != 0 or not shutil.which("apt-get"):
        sys.exit("This needs root on a Debian: it installs packages and runs in a chroot.")
    if not all(shutil.which(name) for name in PACKAGES):
        subprocess.run(["apt-get", "update", "-qq"], check=True)
        install = ["apt-get", "install", "-qq", "--yes", "--no-install-recommends", *PACKAGES]
        subprocess.run(install, check=True, stdout=subprocess.DEVNULL)
    parsed.place.mkdir(parents=True, exist_ok=True)
    builder = Builder(parsed.place)
    try:
        make_base_image(builder, parsed.place)
        build(builder)
        try_out(builder)
    finally:
        if not parsed.keep:
            shutil.rmtree(parsed.place, ignore_errors=True)


if __name__ == "__main__":
    main()
