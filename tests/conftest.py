"""Fixtures and settings of all tests."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess
import sys
from collections.abc import Generator, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path

import pytest
from httpx._transports import default as http_transports
from hypothesis import settings

from tests import progress
from tests.server.service_process import Service
from tests.web.blog import Blog

# Programs that tests start, and this one with its rewritten assertions, compile what they import
# only once, also where the environment forbids it.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Each HTTP client would read the certificates of all authorities, for 34 ms of the processor.
http_transports.create_ssl_context = cache(http_transports.create_ssl_context)
# Tests write and remove some ten thousand files, many of them durably: in memory, where there is
# enough, this takes a third less time. Docker's default has too little.
MEMORY = Path("/dev/shm")
MIN_MEMORY_BYTES = 4 * 2**30
if MEMORY.is_dir() and shutil.disk_usage(MEMORY).free >= MIN_MEMORY_BYTES:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))
# No test asserts wall-clock time, so hypothesis must not either.
settings.register_profile(
    "commit", max_examples=30, deadline=None, derandomize=True, print_blob=True
)
settings.register_profile("thorough", max_examples=300, deadline=None, print_blob=True)
if settings.get_current_profile_name() != "thorough":  # as --hypothesis-profile may have said
    settings.load_profile("commit")


def examples(*, one_of: int) -> settings:
    """Settings of a property whose examples take long: so much fewer than the profile says."""
    return settings(max_examples=max(1, settings.default.max_examples // one_of))


KERNELS = Path(__file__).parents[1] / "planner" / "kernels"
PROCESSES = {
    *("service", "desk", "here_with", "hasty", "broken"),
    *("postgres", "bucket", "browser", "backend"),
}
"""Fixtures that start programs."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """For runs in which kernels are wrong on purpose."""
    parser.addoption(
        "--no-compile", action="store_true", help="compile no kernel before a test needs it"
    )


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Marks what starts programs: ``make test-fast`` leaves it out."""
    for item in items:
        if PROCESSES & set(getattr(item, "fixturenames", ())):
            item.add_marker("processes")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is loaded and collected stays until the end: nobody looks through it for rubbish."""
    gc.disable()
    collected = yield
    gc.freeze()
    gc.enable()
    return collected


def pytest_xdist_auto_num_workers() -> int:
    """One more than there are processors, since tests wait for services and browsers; a few."""
    return min(4, (os.cpu_count() or 1) + 1)


def pytest_configure(config: pytest.Config) -> None:
    """Compiles what is not compiled yet; runs on several processes tell how far they are."""
    if not (hasattr(config, "workerinput") or config.getoption("--no-compile")):
        _compile(config)
    progress.add_to(config)


def _compile(config: pytest.Config) -> None:
    """Has all kernels in their cache: the services of these tests start children without it."""
    stamps = {
        path.name: [path.stat().st_mtime_ns, path.stat().st_size]
        for path in sorted(KERNELS.glob("*.py"))
    }
    compiled = [sys.prefix, version("numba"), stamps]
    cache: pytest.Cache | None = getattr(config, "cache", None)  # none with -p no:cacheprovider
    if cache is None or cache.get("foldback/compiled", None) == compiled:
        return
    print("Compiling the kernels, once: about a minute …", flush=True)
    warm_up = "from planner.pipeline.warm_up import warm_up; warm_up()"
    subprocess.run([sys.executable, "-c", warm_up], cwd=KERNELS.parents[1], check=True)
    cache.set("foldback/compiled", compiled)


@pytest.fixture(scope="session")
def blog() -> Iterator[Blog]:
    """A site that may show folds of the service."""
    blog = Blog()
    yield blog
    blog.stop()


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory, blog: Blog) -> Iterator[Service]:
    """A service with a worker, for all tests of this process: they meet each other's folds.

    Its log is JSON, its figures all may read, and a blog may embed it; the ``desk`` has all three
    as usual.
    """
    service = Service(
        tmp_path_factory.mktemp("service") / "data",
        log_format="json",
        metrics_public=True,
        embed_origins=blog.origin,
    ).start()
    yield service
    assert service.stop() == 0


@pytest.fixture(scope="session")
def wrench(service: Service) -> str:
    """The id of a finished fold of a gallery shape, which is not the gallery's own."""
    fold_id = service.fold(shape="wrench-24", seed="5")["id"]
    assert service.wait_over(fold_id)["status"] == "verified"
    return fold_id
