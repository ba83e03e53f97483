"""Child: a computing process with requests on standard input and events on standard output."""

from __future__ import annotations

import contextlib
import errno
import json
import os
import queue
import resource
import sys
import threading
import traceback
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import asdict
from fcntl import LOCK_EX, flock
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, Final, NamedTuple, cast

import psutil
from setproctitle import setproctitle

from foldback.planner.errors import InputError
from foldback.planner.progress import Cancelled, Progress, Report
from foldback.planner.storage.files import settle
from foldback.server.errors import UNEXPECTED_WORDS
from foldback.server.processes.landlock import Allowed, no_new_rights
from foldback.server.processes.limits import memory_words
from foldback.server.processes.sandbox import confine, confine_thread
from foldback.server.processes.scratch import request_in

if TYPE_CHECKING:
    from foldback.planner.pipeline.fold_layout import Derived

LOW_PRIORITY_KINDS: Final = ("stages", "movies", "retimer", "figures")
"""Kinds of computing processes that run with the configured niceness (a low priority), as no page
waits for their results, or only a part of one."""
FULL_DISK_ERRNOS: Final = (errno.ENOSPC, errno.EDQUOT)
FAILED_DISK_ERRNOS: Final = (errno.EROFS, errno.EIO)
NO_THREAD: Final = "can't start new thread"
"""Message of the ``RuntimeError`` that Python raises if no memory is left for the stack of a
thread."""
COMPUTING_LIBRARIES: Final = (
    "mujoco",
    "scipy.interpolate",
    "scipy.ndimage",
    "scipy.optimize",
    "scipy.sparse.csgraph",
)
"""Libraries that the planner imports with its first computation. Processes that compute import them
at their start, so that the first task does not wait."""
MESH_LIBRARY: Final = "trimesh"
"""Library that the planner imports with the first mesh. Processes that read meshes import it at
their start, so that the first upload does not wait."""
PICTURE_LIBRARIES: Final = ("PIL.ImageOps", "PIL.JpegImagePlugin", "PIL.PngImagePlugin", "resvg_py")
"""Libraries that the planner imports with the first picture. Processes that compute previews import
them at their start."""


class Request(NamedTuple):
    """Request to a child.

    Attributes:
        task: Name of the task.
        directory: Directory of the task's files.
        epoch: Epoch of the execution that computes a fold; an execution that takes the fold over
            has a larger one.
    """

    task: str
    directory: Path
    epoch: int = 0


Task = Callable[[Request, Report, Cancelled], dict[str, Any]]
Work = Callable[[Path, Cancelled], dict[str, Any]]


class _Parent:
    """Connection to the parent process: its requests, cancellations and end."""

    def __init__(self, events: BinaryIO) -> None:
        self._events = events
        self._requests: queue.Queue[Request] = queue.Queue()
        self._cancel = threading.Event()

    def first_request(self) -> Request:
        """Wait for the first request, without starting a thread that could not be confined."""
        line = sys.stdin.buffer.readline()
        if not line:
            os._exit(1)
        return _request(json.loads(line))

    def listen(self) -> None:
        """Receive further requests and cancellations in a separate thread."""
        threading.Thread(target=self._listen, daemon=True).start()

    def request(self) -> Request:
        """Wait for the next request and return it."""
        self._cancel.clear()
        return self._requests.get()

    def cancelled(self) -> bool:
        """Return True if the current request is cancelled."""
        return self._cancel.is_set()

    def tell(self, event: str, **values: object) -> None:
        """Send an event; end the process if the parent has ended."""
        try:
            self._events.write(json.dumps({"event": event, **values}).encode() + b"\n")
            self._events.flush()
        except BrokenPipeError:
            os._exit(1)

    def progress(self, progress: Progress) -> None:
        """Send progress."""
        self.tell("progress", **asdict(progress))

    def _listen(self) -> None:
        for line in sys.stdin.buffer:
            message = json.loads(line)
            if message.get("cancel"):
                self._cancel.set()
            else:
                self._requests.put(_request(message))
        os._exit(1)


def _request(message: dict[str, Any]) -> Request:
    return Request(message["task"], Path(message["directory"]), message["epoch"])


LOCK_FILE: Final = ".lock"
"""Name of the file in a fold's directory that its computing process locks."""
EPOCH_DIGITS: Final = 12
"""Number of digits of an epoch in the lock file of a fold's directory: more than any epoch has."""


def _offer() -> None:
    """Let the kernel kill this process before the service if memory runs out."""
    with contextlib.suppress(OSError):
        Path("/proc/self/oom_score_adj").write_text("500")


def _limit(memory_bytes: int, cpu_s: float) -> None:
    seconds = int(cpu_s) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    # The parent monitors resident memory; this limit stops a single huge allocation. It counts
    # address space: libraries and the stacks of their threads reserve far more than they use.
    reserved = getattr(psutil.Process().memory_info(), "data", 0)  # only on Linux
    data = reserved + 2 * memory_bytes
    resource.setrlimit(resource.RLIMIT_DATA, (data, data))
    for name, max_value in (
        (resource.RLIMIT_FSIZE, 8 * 2**30),  # a faulty input must not fill the disk
        (resource.RLIMIT_NOFILE, 512),
    ):
        hard = resource.getrlimit(name)[1]
        max_value = max_value if hard == resource.RLIM_INFINITY else min(max_value, hard)
        resource.setrlimit(name, (max_value, max_value))
    no_new_rights()


def _end_without_memory(parent: _Parent, memory_bytes: int) -> None:
    """End this process when one of its threads runs out of memory.

    Code that waits for that thread would wait until the time limit: ``Thread.start`` itself waits
    forever for a thread that dies before it runs.
    """

    def hook(default: Callable[[Any], object]) -> Callable[[Any], None]:
        def end(unhandled: threading.ExceptHookArgs | sys.UnraisableHookArgs) -> None:
            if issubclass(unhandled.exc_type, MemoryError):
                _tell_memory_limit(parent, memory_bytes)
                os._exit(1)
            default(unhandled)

        return end

    threading.excepthook = hook(threading.__excepthook__)
    sys.unraisablehook = hook(sys.__unraisablehook__)


def _step_back(niceness: int) -> None:
    """Lower this process's priority."""
    os.nice(niceness)
    # With autogroup scheduling, niceness has an effect only within a session; this lowers the
    # priority of the whole session.
    with suppress(OSError):
        Path("/proc/self/autogroup").write_text(str(niceness))


def _stages() -> Task:
    from foldback.planner.pipeline.stages import run_stage

    _load(*COMPUTING_LIBRARIES, MESH_LIBRARY)

    def run(request: Request, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
        stage, directory, _ = request
        os.chdir(directory)  # some libraries write logs to the current directory
        with _locked(request) as is_locked:
            if not is_locked:
                return {"status": "cancelled", "reason": "another process has taken over the fold"}
            result = dict(run_stage(stage, directory, progress=progress, cancelled=cancelled))
            # Once a stage is recorded as finished, its files must survive a power failure.
            settle(directory)
            return result

    return run


@contextmanager
def _locked(request: Request) -> Generator[bool]:
    """Lock the directory of a fold; yield False if a later execution has had the lock.

    The child of a worker that was killed or suspended may still run. It must neither compute at the
    same time as the child of the execution that took over, nor between two stages of that one, when
    the lock is free. The lock's file therefore holds the largest epoch so far (a fencing token).
    """
    descriptor = os.open(request.directory / LOCK_FILE, os.O_RDWR | os.O_CREAT, 0o644)
    try:
        flock(descriptor, LOCK_EX)
        is_newest = request.epoch >= int(os.pread(descriptor, EPOCH_DIGITS, 0) or 0)
        if is_newest:
            os.pwrite(descriptor, str(request.epoch).zfill(EPOCH_DIGITS).encode(), 0)
        yield is_newest
    finally:
        os.close(descriptor)


def _load(*names: str) -> None:
    """Load libraries that the planner imports lazily; a confined process cannot load them."""
    for name in names:
        import_module(name)


def _confined(works: Mapping[str, Work], *, beside: Collection[str] = ()) -> Task:
    """Return a task that runs each call in a thread confined to the call's directory.

    This separates visitors, because one process works for many of them.

    Args:
        works: Functions by task name.
        beside: Names of tasks that also read or write the parent of their directory.
    """

    def run(request: Request, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
        del progress
        task, directory, _ = request
        place = directory.parent if task in beside else directory
        with ThreadPoolExecutor(1) as thread:
            thread.submit(confine_thread, place).result()
            return thread.submit(works[task], directory, cancelled).result()

    return run


def _reader() -> Task:
    from foldback.server.processes.read_task import check, offers, preview

    _load(MESH_LIBRARY)
    works: dict[str, Work] = {
        "check": lambda directory, _: check(directory),
        "preview": lambda directory, _: preview(directory),
        "offers": offers,
    }
    return _confined(works, beside=("preview", "offers"))


def _preparer() -> Task:
    # So that the first preview does not wait for these imports.
    _load(
        "foldback.planner.pipeline.prepare",
        "foldback.planner.shapes.decimation",
        "foldback.planner.table_paths.offers",
        "foldback.planner.pathfinding.filling_methods",
        "foldback.planner.pathfinding.shape_overlap",
        "foldback.planner.pipeline.drawn_shape",
        *PICTURE_LIBRARIES,
    )
    return _reader()


def _movies() -> Task:
    from foldback.planner.errors import TimelineError
    from foldback.web.movies.encoding import EncodingError, NoEncoderError
    from foldback.web.movies.make_movie import make_movie
    from foldback.web.movies.movie import Movie
    from foldback.web.movies.renderer import NoGLError

    _load("mujoco")

    def run_movie(request: Request, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
        backend, directory, _ = request
        movie_request = request_in(directory)
        movie = Movie.of(movie_request["movie"])
        try:
            is_complete = make_movie(
                Path(movie_request["timeline"]),
                movie,
                directory / movie_request["part"],
                on_table=movie_request["on_table"],
                backend=backend,
                progress=lambda done: progress(
                    Progress(stage="movie", fraction=done / movie.count, steps=done)
                ),
                cancelled=cancelled,
            )
        except NoGLError as error:
            return {"status": "no-gl", "reason": str(error)}
        except NoEncoderError as error:
            return {"status": "no-encoder", "reason": str(error)}
        except EncodingError as error:
            return {"status": "not-encoded", "reason": str(error)}
        except TimelineError as error:
            raise InputError("no-timeline", str(error)) from error
        return {"status": "done" if is_complete else "cancelled"}

    return run_movie


def _retimer() -> Task:
    from foldback.server.processes.retime_task import clearance, motors, retime

    _load(*COMPUTING_LIBRARIES)
    works: dict[str, Work] = {
        "retime": lambda directory, _: retime(directory),
        "clearance": lambda directory, _: clearance(directory),
        "motors": lambda directory, _: motors(directory),
    }
    return _confined(works)


def _figures() -> Task:
    from foldback.planner.errors import PlannerError
    from foldback.planner.pipeline.derived_files import complete

    _load(*COMPUTING_LIBRARIES)

    def run(request: Request, progress: Report, cancelled: Cancelled) -> dict[str, Any]:
        del progress, cancelled
        try:
            complete(request.directory, cast("Derived", request.task))
        except PlannerError as error:
            raise InputError("no-figures", str(error)) from error
        settle(request.directory)
        return {}

    return run


def _pictures() -> Task:
    from foldback.server.processes.picture_task import draw

    return _confined({"picture": lambda directory, _: draw(directory)})


def _work(kind: str, directory: Path, folders: Sequence[str]) -> Allowed:
    """Return the files and directories that a child may access."""
    if kind == "movies":
        timeline = request_in(directory)["timeline"]
        return Allowed(readable=(Path(timeline),), writable=(directory,))
    return Allowed(writable=tuple(map(Path, folders)) or (directory,))


TASKS: Final[dict[str, Callable[[], Task]]] = {
    "stages": _stages,
    "reader": _reader,
    "preparer": _preparer,
    "movies": _movies,
    "retimer": _retimer,
    "figures": _figures,
    "pictures": _pictures,
}
"""Functions that load the libraries of a kind of child and return its task."""


def task_of(kind: str) -> Task:
    """Load the libraries of a kind of child and return its task."""
    return TASKS[kind]()


def serve(kind: str, limits: Mapping[str, Any], load: Callable[[], Task]) -> None:
    """Serve requests until the parent has ended.

    Args:
        kind: Kind of this child.
        limits: Fields of ``ChildLimits``.
        load: Loads the task of this kind.
    """
    setproctitle(f"foldback {kind}")
    if kind in LOW_PRIORITY_KINDS:
        _step_back(int(limits["niceness"]))
    events = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # output that libraries print must not mix with the events
    parent = _Parent(events)
    _offer()
    try:
        task = load()
        _limit(limits["memory_bytes"], limits["cpu_s"])
    except Exception:
        traceback.print_exc()
        parent.tell("problem", code="no-start", detail=UNEXPECTED_WORDS)
        return
    parent.tell("ready")
    request = parent.first_request()
    work = _work(kind, request.directory, limits["folders"])
    try:
        confine(work, drawing=kind == "movies")
    except Exception:
        traceback.print_exc()
        parent.tell("problem", code="no-start", detail="the sandbox could not be set up.")
        return
    _end_without_memory(parent, limits["memory_bytes"])
    parent.listen()
    while True:
        _answer(parent, task, request, limits["memory_bytes"])
        request = parent.request()


def _answer(parent: _Parent, task: Task, request: Request, memory_bytes: int) -> None:
    """Run the task of a request, and send its result or error."""
    try:
        result = task(request, parent.progress, parent.cancelled)
    except InputError as error:
        parent.tell(
            "bad-input",
            code=error.code,
            detail=error.detail,
            where=error.where,
            message=error.message,
            values=error.values,
        )
    except Exception as error:
        if isinstance(error, MemoryError) or str(error) == NO_THREAD:
            _tell_memory_limit(parent, memory_bytes)
            return
        traceback.print_exc()
        code, detail = _problem(error)
        parent.tell("problem", code=code, detail=detail)
    else:
        parent.tell("done", result=result)


def _tell_memory_limit(parent: _Parent, memory_bytes: int) -> None:
    parent.tell("problem", code="memory-limit", detail=memory_words(memory_bytes))


def _problem(error: Exception) -> tuple[str, str]:
    """Return the code and the detail of an unexpected error of a task."""
    if isinstance(error, OSError) and error.errno in FULL_DISK_ERRNOS:
        return "disk-full", (
            "the disk of the service is full, so this task failed; stored data is safe. Try "
            "again later."
        )
    if isinstance(error, OSError) and error.errno in FAILED_DISK_ERRNOS:
        return "disk-failed", (
            f"the service cannot write to its disk ({error.strerror}), so this task failed; stored "
            "data is safe. Try again later."
        )
    return "internal", UNEXPECTED_WORDS


def main() -> None:
    """Load the task, and serve requests until the parent has ended."""
    kind, limits = sys.argv[1], json.loads(sys.argv[2])
    serve(kind, limits, partial(task_of, kind))


if __name__ == "__main__":
    main()
