"""Trajectories: retimed plans, computed in a child process, and cached.

The results are memory-mapped from files that are already unlinked. Unused parts of a long
trajectory thus take no memory, and its disk space is freed with its last user.
"""

from __future__ import annotations

import json
import shutil
import weakref
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal
from zipfile import BadZipFile, ZipFile

from foldback.planner.readers.limits import megabytes
from foldback.planner.storage.file_names import PLAN
from foldback.server.errors import NotFound, ServiceError, TooLarge, Unavailable, Unusable, no_room
from foldback.server.limits.concurrency_quota import Permit, Quota
from foldback.server.limits.single_flight import SingleFlight
from foldback.server.processes.children import ChildError, Pool
from foldback.server.processes.scratch import MOTORS_FILE, Scratch
from foldback.server.settings import Settings
from foldback.web.timeline.cache import Cache

if TYPE_CHECKING:
    from foldback.planner.trajectories.trajectory import Trajectory

STREAMS, STREAMS_OF_ADDRESS = 8, 2
"""Maximum numbers of trajectories that are sent at the same time, in total and to one address."""
MAX_MOTOR_REQUIREMENTS_BYTES: Final = 32 * 2**20
"""Maximum size of the table of motor torques that a computing process returns, in bytes; a larger
table is refused. The table of 12 000 modules has about 5 MB."""
MAX_RETIMED_PLAN_BYTES: Final = 64 * 2**20
"""Maximum file size of a plan to which the service gives a new timing for a robot, in bytes; larger
plans are left to the command line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryRequest:
    """Requested trajectory: a plan and the bounds of the motion.

    Attributes:
        plan: The plan's file.
        changed_ns: Time of its last change, ns since 1970.
        size: Size of the plan's file, bytes.
        max_speed: Bound of every joint's speed, in rad/s.
        max_acceleration: Bound of every joint's acceleration, in rad/s².
    """

    plan: Path
    changed_ns: int
    size: int
    max_speed: float
    max_acceleration: float

    @classmethod
    def of(cls, plan: Path, max_speed: float, max_acceleration: float) -> TrajectoryRequest:
        """Return the request for a plan's file, with its current size and time.

        Raises:
            OSError: If there is no such file.
            TooLarge: If it is too large.
        """
        stat = plan.stat()
        if stat.st_size > MAX_RETIMED_PLAN_BYTES:
            raise TooLarge(
                "too-large",
                f"got a plan of {megabytes(stat.st_size)}, expected at most "
                f"{megabytes(MAX_RETIMED_PLAN_BYTES)}; download plan.npz and "
                "use `foldback retime`.",
                bytes=stat.st_size,
                max_bytes=MAX_RETIMED_PLAN_BYTES,
            )
        return cls(
            plan=plan,
            changed_ns=stat.st_mtime_ns,
            size=stat.st_size,
            max_speed=max_speed,
            max_acceleration=max_acceleration,
        )

    def request(self) -> dict[str, Any]:
        """Return the request for the computing process, which finds the plan in its directory."""
        return {"max_speed": self.max_speed, "max_acceleration": self.max_acceleration}


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorsRequest:
    """Robot for a table of motors, and the table's format.

    Attributes:
        module_mass_kg: Mass of a module, kg.
        pitch_m: Distance between neighbouring modules, m; the plan's when None.
        gravity_m_s2: Gravitational acceleration, m/s².
        held: True if the root module is fixed.
        motor_torque_nm: Torque limit of a motor, N·m; None if not given.
        form: Format of the table: ``csv`` or ``json``.
    """

    module_mass_kg: float
    pitch_m: float | None
    gravity_m_s2: float
    held: bool
    motor_torque_nm: float | None
    form: Literal["csv", "json"]


@dataclass(frozen=True, slots=True, kw_only=True, weakref_slot=True, eq=False)
class Retimed:
    """A trajectory, the name of its chain, and whether its plan is verified."""

    name: str
    verified: bool
    trajectory: Trajectory


class Trajectories:
    """Cache of retimed plans. Belongs to one event loop; waiting requests occupy no thread.

    Args:
        settings: Limits, and the directories of the computing processes and of their results.
        pool: Child processes that retime plans.
        kept_bytes: Maximum size of cached trajectories that are not in use, bytes.
        used_bytes: Maximum size of all trajectories, with those in use, bytes.
    """

    def __init__(
        self,
        settings: Settings,
        pool: Pool,
        *,
        kept_bytes: int = 128 * 2**20,
        used_bytes: int = 2**30,
    ) -> None:
        self._pool = pool
        self._motions = Scratch(settings.motions_dir)
        self._scratch = Scratch(settings.scratch_dir)
        self._flight = SingleFlight(
            "trajectories",
            at_once=1,
            total=settings.answers_waiting,
            per_visitor=settings.answers_waiting_of_visitor,
        )
        self._streams = Quota("motions", total=STREAMS, per_visitor=STREAMS_OF_ADDRESS)
        self._cache: Cache[Retimed] = Cache(kept_bytes, lambda retimed: retimed.trajectory.nbytes)
        self._clearances: Cache[dict[str, Any]] = Cache(1024, lambda _: 1)
        self._used: weakref.WeakValueDictionary[TrajectoryRequest, Retimed] = (
            weakref.WeakValueDictionary()
        )
        self._used_bytes = used_bytes

    @property
    def nbytes(self) -> int:
        """Total size of all trajectories that are cached or in use, bytes."""
        trajectories = [retimed.trajectory for retimed in self._used.values()]
        shared = {id(t.path.frames): t.path.frames.nbytes for t in trajectories}
        return sum(shared.values()) + sum(t.nbytes - t.path.frames.nbytes for t in trajectories)

    def close(self) -> None:
        """End the children."""
        self._flight.close()
        self._pool.close()

    async def of(self, timing: TrajectoryRequest, visitor: str) -> Retimed:
        """Return the requested trajectory; it is computed once for all concurrent requests.

        Raises:
            ServiceError: If it needs too much time or memory, too many wait or are in use, or the
                disk is full.
            InputError: If the plan cannot be retimed.
        """
        used = self._used.get(timing)
        if used is None:
            used = await self._flight.get_or_make(
                timing, lambda: self._retimed(timing), visitor=visitor
            )
            used = self._used.setdefault(timing, self._shared(timing, used))
        self._cache.keep(timing, used)
        if self.nbytes > self._used_bytes:
            self._cache.clear()
        if self.nbytes > self._used_bytes:
            raise Unavailable(
                "busy",
                "The service is busy with other long trajectories; try again in a moment.",
                retry_after_s=30,
            )
        return used

    async def motors(self, timing: TrajectoryRequest, motors: MotorsRequest, visitor: str) -> bytes:
        """Return the torques that a trajectory needs, as ``MotorRequirements`` writes them.

        Raises:
            ServiceError: See ``of``.
            InputError: If the plan cannot be retimed, or the motors cannot be built.
        """

        def made() -> bytes:
            with self._motions.directory() as place:
                self._call("motors", place, timing, {**timing.request(), **asdict(motors)})
                with open(place / MOTORS_FILE, "rb") as file:
                    data = file.read(MAX_MOTOR_REQUIREMENTS_BYTES + 1)
                if len(data) > MAX_MOTOR_REQUIREMENTS_BYTES:
                    raise _too_large()
                return data

        return await self._flight.get_or_make((timing, motors), made, visitor=visitor)

    async def clearance(
        self, timing: TrajectoryRequest, rate_hz: float | None, visitor: str
    ) -> tuple[float, float]:
        """Return the minimum clearance and its bound for straight motions between rows, pitches.

        Raises:
            ServiceError: See ``of``; ``rows-overlap`` if modules overlap between the rows.
            InputError: If the plan cannot be retimed.
        """

        def made() -> dict[str, Any]:
            with self._motions.directory() as place:
                request = {**timing.request(), "rate_hz": rate_hz}
                return self._call("clearance", place, timing, request)

        clearances = await self._flight.get_or_make(
            (timing, rate_hz), made, visitor=visitor, cache=self._clearances
        )
        if clearances["overlap"]:
            enough = clearances["sufficient_rate_hz"]
            advice = "use rate={rate_hz:g}" if enough else "request a higher rate, or omit rate"
            raise Unusable(
                "rows-overlap",
                "got a rate so low that modules overlap by {depth:.2g} pitch between two "
                f"consecutive rows, expected no overlap; {advice}.",
                where="query.rate",
                depth=-clearances["min_clearance"],
                rate_hz=enough,
            )
        return clearances["min_clearance"], clearances["clearance_bound"]

    def stream(self, address: str) -> Permit:
        """Return a permit to send a trajectory.

        Raises:
            TooMany: If the maximum number is already being sent.
        """
        return self._streams.enter(address)

    def _shared(self, timing: TrajectoryRequest, retimed: Retimed) -> Retimed:
        """Return a trajectory that shares its frames with others of the same plan, if any."""
        for used_timing, used in self._used.items():
            if (used_timing.plan, used_timing.changed_ns) == (timing.plan, timing.changed_ns):
                path = replace(retimed.trajectory.path, frames=used.trajectory.path.frames)
                return replace(retimed, trajectory=replace(retimed.trajectory, path=path))
        return retimed

    def _retimed(self, timing: TrajectoryRequest) -> Retimed:
        from foldback.planner.trajectories.trajectory import FRAMES_FILE, REST_FILE

        with self._motions.directory() as place, self._scratch.directory() as directory:
            summary = self._call("retime", place, timing, timing.request())
            # Copied, because the child may still change or truncate its own files, and this process
            # reads from them for as long as the trajectory is used.
            for name in (FRAMES_FILE, REST_FILE):
                _copy(place / name, directory / name, self._used_bytes)
            return Retimed(
                name=summary["name"],
                verified=summary["verified"],
                trajectory=_loaded(directory, self._used_bytes),
            )

    def _call(
        self, task: str, place: Path, timing: TrajectoryRequest, request: dict[str, Any]
    ) -> dict[str, Any]:
        (place / "request.json").write_text(json.dumps(request))
        # The child can access only this directory. It gets a copy of the plan, because through a
        # link it could change the plan itself.
        try:
            shutil.copyfile(timing.plan, place / PLAN)
        except FileNotFoundError as error:
            raise NotFound("no-such-fold", "This fold has just been deleted.") from error
        try:
            return self._pool.call(task, place)
        except ChildError as error:
            raise _problem(error) from error


def _copy(source: Path, target: Path, max_bytes: int) -> None:
    """Copy a file that may still grow.

    Raises:
        TooLarge: If it has more bytes than ``max_bytes``.
    """
    with open(source, "rb") as read, open(target, "wb") as written:
        while piece := read.read(2**20):
            if written.tell() + len(piece) > max_bytes:
                raise _too_large()
            written.write(piece)


def _loaded(directory: Path, max_bytes: int) -> Trajectory:
    """Return the trajectory in a directory.

    Raises:
        ServiceError: If it unpacks to more bytes than ``max_bytes``, or is invalid.
    """
    from foldback.planner.trajectories.trajectory import REST_FILE, Trajectory

    try:
        with ZipFile(directory / REST_FILE) as parts:
            if sum(part.file_size for part in parts.infolist()) > max_bytes:
                raise _too_large()
        return Trajectory.load(directory)
    except (BadZipFile, OSError, ValueError, KeyError, TypeError, MemoryError) as error:
        raise Unavailable(
            "crashed",
            "The trajectory could not be read; try again.",
            retry_after_s=5,
        ) from error


def _too_large() -> TooLarge:
    return TooLarge(
        "too-large",
        "This motion needs more time or memory than this service allows; download plan.npz and use "
        "`foldback retime`.",
    )


def _problem(error: ChildError) -> ServiceError:
    if error.code in ("time-limit", "cpu-limit", "memory-limit"):
        return _too_large()
    if error.code in ("disk-full", "disk-failed"):
        return no_room(error.detail)
    return Unavailable(error.code, error.detail, retry_after_s=5)
