"""Fixtures and settings of all tests."""

import gc
import os
import shutil
import signal
import sys
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path

import pytest
from httpx._transports import default as http_transports
from hypothesis import settings

from tests import progress
from tests.server.service_process import SNAKE, FinishedFold, Service
from tests.web.blog import Blog

# Tests and the programs that they start compile each imported module only once, even if the
# environment forbids storing bytecode.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# Each HTTP client would read the certificates of all authorities, which takes 34 ms of processor
# time.
http_transports.create_ssl_context = cache(http_transports.create_ssl_context)


# Tests write and remove some ten thousand files, many of them durably. A file system in memory
# takes a third less time, but Docker's default is too small.
MEMORY = Path("/dev/shm")
MIN_MEMORY_BYTES = 4 * 2**30
if MEMORY.is_dir() and shutil.disk_usage(MEMORY).free >= MIN_MEMORY_BYTES:
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", str(MEMORY))
# No test asserts wall-clock time, so hypothesis must not either.
settings.register_profile(
    "commit", max_examples=30, deadline=None, derandomize=True, print_blob=True
)
settings.register_profile("thorough", max_examples=300, deadline=None, print_blob=True)
if settings.get_current_profile_name() != "thorough":  # set by --hypothesis-profile
    settings.load_profile("commit")


def examples(*, one_of: int) -> settings:
    """Return settings for slow examples: the profile's number divided by ``one_of``."""
    return settings(max_examples=max(1, settings.default.max_examples // one_of))


PROCESSES = {
    *("service", "idle", "service_with", "hasty", "broken"),
    *("postgres", "bucket", "browser", "backend"),
}
"""Fixtures that start programs."""


@pytest.hookimpl(tryfirst=True)  # before tests are selected by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark tests that start programs, which ``make test-fast`` leaves out, and put files that share
    a service first.

    Processes that run tests begin with consecutive tests, and later take others' last ones: in this
    order few processes start a service and a browser of their own, and short tests come last.
    """
    sharing: set[Path] = set()
    for item in items:
        fixtures = set(getattr(item, "fixturenames", ()))
        if PROCESSES & fixtures:
            item.add_marker("processes")
        if "service" in fixtures and "browser" not in item.path.parts:
            sharing.add(item.path)
    tests = Path(__file__).parent

    def rank(item: pytest.Item) -> int:
        folder = item.path.relative_to(tests).parts[0]
        return 1 if item.path in sharing else {"browser": 0, "server": 2}.get(folder, 3)

    items.sort(key=rank)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Exclude all objects loaded so far from garbage collection."""
    gc.disable()
    collected = yield
    gc.freeze()
    gc.enable()
    return collected


def pytest_xdist_auto_num_workers() -> int:
    """Return the number of processes: one more than processors, as tests wait; at most 4."""
    return min(4, (os.cpu_count() or 1) + 1)


def pytest_configure(config: pytest.Config) -> None:
    """Let runs on several processes report their progress, and Ctrl+C reach what tests start."""
    progress.add_to(config)
    # A shell lets background jobs ignore it, and programs that they start would, too.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def blog() -> Iterator[Blog]:
    """Site that may embed folds of the service."""
    with Blog() as blog:
        yield blog
        blog.shutdown()


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory, blog: Blog) -> Iterator[Service]:
    """Service with a worker, for all tests of this process, which see each other's folds.

    Its log is JSON, its metrics are public, and a blog may embed it; ``idle`` has the defaults.
    """
    data = tmp_path_factory.mktemp("service") / "data"
    settings = {"log_format": "json", "metrics_public": True, "embed_origins": blog.origin}
    with Service(data, **settings).start() as service:
        yield service


@pytest.fixture(scope="session")
def wrench(service: Service) -> str:
    """Id of a finished fold of a gallery shape by an explosion, not the gallery's own fold."""
    fold_id = service.fold(shape="wrench-24", seed="5", strategy="simultaneous")["id"]
    assert service.wait_over(fold_id)["status"] == "verified"
    return fold_id


@pytest.fixture(scope="session")
def finished(service: Service) -> FinishedFold:
    """Finished fold of a path without a name, by an explosion."""
    accepted = service.fold(SNAKE, seed="3", strategy="simultaneous")
    events = list(service.events(accepted["id"]))
    return FinishedFold(service, accepted, events, service.state(accepted["id"]))
