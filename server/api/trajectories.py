"""Routes for real robots: trajectories, joint torques, and target streams in real time."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any, Final, Literal, cast

import msgspec
from fastapi import APIRouter, Depends, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.responses import Response, StreamingResponse
from numpy.typing import NDArray

from foldback.planner.errors import DamagedError, InputError
from foldback.planner.storage.file_names import PLAN
from foldback.planner.verification.integrity import check
from foldback.server.context import Context, Here, context_of
from foldback.server.dependencies.described_answers import file_or_problems
from foldback.server.dependencies.requested_folds import not_there
from foldback.server.errors import (
    Conflict,
    ServiceError,
    TooLarge,
    TooMany,
    TooSlow,
    Unavailable,
    Unusable,
    WebsocketNeeded,
    refusal_of,
)
from foldback.server.files.trajectories import MotorsRequest, Retimed, TrajectoryRequest
from foldback.server.http.client_address import address_of
from foldback.server.http.limited_stream import LimitedStream
from foldback.server.http.websockets import close, first_of, receive
from foldback.server.store.folds import FoldRow, NoSuchFoldError
from foldback.server.target_streams.stream_clock import MAX_CLOCK_STEP_S, Reason, StreamClock
from foldback.server.target_streams.stream_messages import (
    DECODER,
    ENCODER,
    PLAY_FORMAT,
    Begin,
    End,
    Outgoing,
    Pause,
    PlayOptions,
    Report,
    Resume,
    Running,
    Stop,
    StreamProblem,
    Target,
    Waiting,
    schema,
)
from foldback.server.viewing.fold_lookup import ADDRESS_ID

router = APIRouter(prefix="/api/folds/{fold_id}", tags=["robots"])
schemas = APIRouter(prefix="/api", tags=["robots"])
MAX_TRAJECTORY_NUMBERS: Final = 5_000_000
"""Maximum count of numbers (samples × joints × 2) in a downloaded joint trajectory; a larger one is
refused."""
MAX_MOTOR_MODULES: Final = 1000
"""Maximum number of modules of a chain whose motor torques the service computes on request; longer
chains are left to the command line."""
TRAJECTORY_MEDIA_TYPES: Final = {"csv": "text/csv; charset=utf-8", "json": "application/json"}
REFUSED, TRY_LATER, DONE = 1008, 1013, 1000
MAX_MESSAGES_PER_SECOND: Final = 400
"""Maximum number of websocket messages that a client may send per second; more of them end
its connection."""
STREAM_TIMEOUT_S: Final = 60.0
"""Time, in s, after which the connection to a client ends if it has sent no message, or has
read none."""
REMINDER_S: Final = 1.0
"""Time after which the current target is sent again to a client that does not report, in s."""

DOCUMENTED_FORMS: Final = ("application/json", "text/csv")
"""Media types that the API's description states for trajectories and motors."""
COMPUTING_PROBLEMS: Final = (404, 409, 413, 422, 429, 503)
"""HTTP statuses of refusals to compute trajectories or motors."""


Speed = Annotated[float, Query(ge=1e-3, le=1e3, description="Maximum joint speed, rad/s.")]
Acceleration = Annotated[
    float, Query(ge=1e-3, le=1e4, description="Maximum joint acceleration, rad/s².")
]
Form = Literal["csv", "json"]


@router.get(
    "/trajectory",
    summary="Get the plan with time stamps for a robot",
    response_class=Response,
    responses=file_or_problems(
        "The trajectory, as foldback-trajectory/1 or as a table",
        *DOCUMENTED_FORMS,
        problem=COMPUTING_PROBLEMS,
    ),
)
async def get_trajectory(
    request: Request,
    fold_id: str,
    context: Here,
    max_speed: Speed = 1.0,
    max_acceleration: Acceleration = 2.0,
    form: Annotated[Form, Query(alias="format")] = "json",
    rate: Annotated[
        float | None,
        Query(gt=0, le=1e4, description="Rows per second. Default: one row per frame of the plan."),
    ] = None,
) -> StreamingResponse:
    """Return the fastest motion along the plan within the limits; it starts and ends at rest.

    A rate is refused if it gives so few rows per second that modules of a verified plan overlap
    between consecutive rows.
    """
    from foldback.planner.exports.trajectory import export

    visitor = address_of(request)
    _, timing = await asyncio.to_thread(_wanted, context, fold_id, max_speed, max_acceleration)
    retimed = await context.trajectories.of(timing, visitor)
    trajectory = retimed.trajectory
    moments = len(trajectory.time_s) if rate is None else rate * trajectory.duration_s + 2
    numbers = 2.0 * moments * len(trajectory.joint_names)
    if numbers > MAX_TRAJECTORY_NUMBERS:
        raise TooLarge(
            "too-large",
            "got a trajectory of {numbers:.3g} numbers, expected at most {limit:.3g}; lower the "
            "rate, or use `foldback retime`.",
            where="query.rate",
            numbers=numbers,
            limit=MAX_TRAJECTORY_NUMBERS,
        )
    clear = None
    if retimed.verified:
        clear = await context.trajectories.clearance(timing, rate, visitor)
    parts = export(
        trajectory,
        form,
        name=retimed.name,
        plan_verified=retimed.verified,
        clear=clear,
        rate_hz=rate,
    )
    return LimitedStream(
        parts,
        context.trajectories.stream(visitor),
        media_type=TRAJECTORY_MEDIA_TYPES[form],
        headers={"Content-Disposition": f'attachment; filename="trajectory.{form}"'},
        longest_s=300.0,
    )


async def motors_in_query(
    module_mass: Annotated[float, Query(gt=0, le=1e6, description="Mass of a module, kg.")],
    max_speed: Speed = 1.0,
    max_acceleration: Acceleration = 2.0,
    pitch: Annotated[
        float | None,
        Query(
            gt=0,
            le=1e3,
            description="Distance between module centres, m. Default: the plan's pitch.",
        ),
    ] = None,
    gravity: Annotated[
        float,
        Query(
            ge=0,
            le=1e3,
            description="Gravity, m/s². It acts in the worst direction for each joint.",
        ),
    ] = 9.81,
    floating: Annotated[
        bool,
        Query(
            description="True: the chain floats without gravity. False: its middle module is held."
        ),
    ] = False,
    motor_torque: Annotated[
        float | None, Query(gt=0, le=1e9, description="Largest torque of a motor, N·m.")
    ] = None,
    form: Annotated[Form, Query(alias="format")] = "json",
) -> tuple[float, float, MotorsRequest]:
    """Return the speed and acceleration of the motion, rad/s and rad/s², and the motors."""
    motors = MotorsRequest(
        module_mass_kg=module_mass,
        pitch_m=pitch,
        gravity_m_s2=gravity,
        held=not floating,
        motor_torque_nm=motor_torque,
        form=form,
    )
    return max_speed, max_acceleration, motors


@router.get(
    "/motors",
    summary="Get the torques that the plan needs",
    response_class=Response,
    responses=file_or_problems(
        "One row per joint, and whether the given motors are strong enough",
        *DOCUMENTED_FORMS,
        problem=COMPUTING_PROBLEMS,
    ),
)
async def get_motors(
    request: Request,
    fold_id: str,
    context: Here,
    query: Annotated[tuple[float, float, MotorsRequest], Depends(motors_in_query)],
) -> Response:
    """Compute the torques by inverse dynamics for the motion that `trajectory` returns."""
    speed, acceleration, motors = query
    row, timing = await asyncio.to_thread(_wanted, context, fold_id, speed, acceleration)
    if row.modules > MAX_MOTOR_MODULES:
        raise TooLarge(
            "too-large",
            "got {count} modules, expected at most {limit}; use `foldback retime`.",
            count=row.modules,
            limit=MAX_MOTOR_MODULES,
        )
    data = await context.trajectories.motors(timing, motors, address_of(request))
    csv = motors.form == "csv"
    headers = {"Content-Disposition": 'attachment; filename="motors.csv"'} if csv else {}
    return Response(data, media_type=TRAJECTORY_MEDIA_TYPES[motors.form], headers=headers)


@router.get("/play", include_in_schema=False)
def get_play() -> Response:
    """Refuse plain HTTP requests, because this address is for a websocket."""
    raise WebsocketNeeded(
        "websocket",
        "Open a websocket at this address; /api/play-schema describes its messages.",
    )


@schemas.get("/play-schema", summary="JSON Schema of the messages of a target stream")
def get_play_schema() -> dict[str, Any]:
    """Return the schema of the websocket at `/api/folds/{fold_id}/play`."""
    return schema()


@router.websocket("/play")
async def play(websocket: WebSocket, fold_id: str) -> None:
    """Send joint targets in real time, and wait whenever the client falls behind.

    Limits are checked before the socket is accepted, because until then an error can be sent as an
    HTTP response.
    """
    context = context_of(websocket)
    visitor = address_of(websocket)
    try:
        options = msgspec.convert(dict(websocket.query_params), PlayOptions, strict=False)
    except msgspec.ValidationError as error:
        raise Unusable("bad-request", f"{error}.", where="query") from error
    with context.target_streams.enter(visitor):
        timing = await asyncio.to_thread(_playable, context, fold_id, options)
        await websocket.accept()
        try:
            retimed = await context.trajectories.of(timing, visitor)
            if not retimed.verified:
                raise _not_verified()
            charge = partial(context.stream_rates.charge, visitor)
            await _TargetStream(websocket, retimed, options, fold_id, charge).play()
            await close(websocket, DONE)
        except (ServiceError, DamagedError, InputError) as error:
            refused = refusal_of(error)
            code = TRY_LATER if isinstance(refused, TooMany | Unavailable) else REFUSED
            await _refuse(websocket, code, refused.code, refused.detail)


def _wanted(
    context: Context, fold_id: str, max_speed: float, max_acceleration: float
) -> tuple[FoldRow, TrajectoryRequest]:
    """Return the row of a finished fold, and the requested trajectory of its plan."""
    row = context.store.fold(fold_id)
    path = context.store.directory(fold_id) / PLAN
    try:
        if row.over:
            check(path.parent, path.name)
            return row, TrajectoryRequest.of(path, max_speed, max_acceleration)
    except OSError:
        pass
    raise not_there(row, "plan")


def _playable(context: Context, fold_id: str, options: PlayOptions) -> TrajectoryRequest:
    """Return the trajectory of a verified fold that a client requests."""
    if not ADDRESS_ID.fullmatch(fold_id):
        raise NoSuchFoldError(fold_id)
    row, timing = _wanted(context, fold_id, options.max_speed, options.max_acceleration)
    if row.status != "verified":
        raise _not_verified()
    return timing


def _not_verified() -> Conflict:
    return Conflict("not-verified", "This plan is not verified, so it cannot be sent to a robot.")


class _TargetStream:
    """Stream of joint targets to one client, in real time."""

    def __init__(
        self,
        websocket: WebSocket,
        retimed: Retimed,
        options: PlayOptions,
        fold_id: str,
        charge: Callable[[int], float],
    ) -> None:
        self._websocket = websocket
        self._charge = charge
        self._trajectory = retimed.trajectory
        self._options = options
        self._fold_id = fold_id
        self._clock = asyncio.get_running_loop().time
        # Before the first target, the robot moves to the start of the motion.
        first = retimed.trajectory.path.frames[0]
        # more than can be unanswered
        self._sent: deque[tuple[int, NDArray[Any]]] = deque([(0, first)], maxlen=64)
        self._at_start = False
        self._number = 0
        self._answered: int | None = None
        self._ahead = max(2, round(0.25 * options.rate_hz))
        self._heard = self._clock()
        self._pace = StreamClock(
            self._trajectory.duration_s,
            speed=options.speed,
            # So that a stop at full speed does not exceed the acceleration limit.
            ramp_s=options.max_speed / options.max_acceleration / options.speed,
            threshold_rad=options.threshold_rad,
            silence_s=options.silence_s,
            now=self._heard,
        )

    async def play(self) -> None:
        """Play until the end, a stop, or the client's disconnection."""
        from foldback.planner.exports.trajectory import largest_chord_error

        options, trajectory = self._options, self._trajectory
        # A client interpolates linearly between targets, which are at most this far apart in time.
        between_s = options.speed * max(1.0 / options.rate_hz, MAX_CLOCK_STEP_S)
        await self._send(
            Begin(
                schema=PLAY_FORMAT,
                fold=self._fold_id,
                joint_names=trajectory.joint_names,
                frames=len(trajectory.time_s),
                duration_s=trajectory.duration_s,
                deviation_rad=trajectory.deviation_rad + largest_chord_error(trajectory, between_s),
                joint_angles_rad=trajectory.path.frames[0].round(6).tolist(),
                **_echoed(options),
            )
        )
        await first_of(self._listen(), self._speak())
        try:
            # Receive remaining messages, and let the client read the end before closing.
            async with asyncio.timeout(5.0):
                while True:
                    await receive(self._websocket)
        except (WebSocketDisconnect, RuntimeError, TimeoutError):
            return

    async def _speak(self) -> None:
        """Send a target at every tick, once the client has reported the start of the motion.

        Late targets are skipped.
        """
        pace, last_sent = self._pace, -REMINDER_S
        last_reason: Reason | Literal["nothing"] | None = "nothing"
        period = 1.0 / self._options.rate_hz
        due = self._clock()
        while True:
            now = self._clock()
            if self._answered is not None:
                pace.behind = self._number - self._answered >= self._ahead
            pace.advance(now)
            if now - self._heard > STREAM_TIMEOUT_S:
                raise TooSlow(
                    "gone", "No message arrived for {limit_s:g} s.", limit_s=STREAM_TIMEOUT_S
                )
            reason = pace.waiting(now)
            if reason != last_reason:
                last_reason = reason
                if reason is None:
                    await self._send(Running(time_s=pace.time_s))
                else:
                    await self._send(
                        Waiting(because=reason, time_s=pace.time_s, error_rad=pace.error_rad)
                    )
            # A client that does not answer gets only one target per ``REMINDER_S``.
            wait_s = 0.0
            if self._at_start and (
                reason not in ("silence", "behind") or now - last_sent >= REMINDER_S
            ):
                last_sent = now
                await self._send_target()
                wait_s = self._charge(len(self._sent[-1][1]) * (2 if self._options.speeds else 1))
            if pace.over(now):
                await self._end("folded")
                return
            due = max(due + period, self._clock() + wait_s)
            await asyncio.sleep(due - self._clock())

    async def _send_target(self) -> None:
        import numpy as np

        moment = np.array([self._pace.time_s])
        angles, speeds, _ = self._trajectory.at(moment)
        rates: Any = msgspec.UNSET
        if self._options.speeds:
            rates = (speeds[0] * self._pace.rate).round(6).tolist()
        self._number += 1
        self._sent.append((self._number, angles[0]))
        await self._send(
            Target(
                number=self._number,
                time_s=round(self._pace.time_s, 6),
                frame=round(float(self._trajectory.frame_at(moment)[0]), 3),
                joint_angles_rad=angles[0].round(6).tolist(),
                joint_speeds_rad_s=rates,
            )
        )

    async def _listen(self) -> None:
        """Process the client's messages."""
        joints = len(self._trajectory.joint_names)
        window, count = 0, 0
        while True:
            data = await receive(self._websocket)
            second = int(self._clock())
            window, count = second, (count + 1 if second == window else 1)
            if count > MAX_MESSAGES_PER_SECOND:
                raise TooMany(
                    "too-fast",
                    "Got more than {limit} messages per second.",
                    limit=MAX_MESSAGES_PER_SECOND,
                )
            if len(data) > 4096 + 32 * joints:
                raise TooLarge(
                    "too-large", "A message of {bytes} bytes is too large.", bytes=len(data)
                )
            try:
                message = DECODER.decode(data)
                self._heard = self._clock()
                if isinstance(message, Stop):
                    await self._end("stop")
                    return
                if isinstance(message, Report):
                    error = self._error_of(message)
                    self._pace.report(error, self._heard)
                    self._at_start = self._at_start or error <= self._options.threshold_rad
                    if not isinstance(message.number, msgspec.UnsetType):
                        self._answered = min(message.number, self._number)
                elif isinstance(message, Pause | Resume):
                    self._pace.paused = isinstance(message, Pause)
            except (msgspec.DecodeError, InputError) as error:
                await self._send(StreamProblem(code="bad-message", detail=f"{error}."))

    def _error_of(self, report: Report) -> float:
        """Return the largest joint error in a report."""
        import numpy as np

        measured = report.joint_angles_rad
        if isinstance(measured, msgspec.UnsetType) is isinstance(
            report.error_rad, msgspec.UnsetType
        ):
            raise InputError("bad-report", "a report needs either error_rad or joint_angles_rad")
        if isinstance(measured, msgspec.UnsetType):
            return float(cast("float", report.error_rad))
        joints = len(self._trajectory.joint_names)
        if len(measured) != joints:
            raise InputError(
                "bad-report",
                "got {count} angles, expected {joints}, one for each joint",
                count=len(measured),
                joints=joints,
            )
        number = self._number if isinstance(report.number, msgspec.UnsetType) else report.number
        target_angles = next((angles for n, angles in self._sent if n >= number), self._sent[-1][1])
        return float(np.abs(np.asarray(measured) - target_angles).max())

    async def _end(self, because: Literal["folded", "stop"]) -> None:
        error = self._pace.error_rad
        await self._send(End(because=because, time_s=self._pace.time_s, error_rad=error))

    async def _send(self, message: Outgoing) -> None:
        try:
            # Not wait_for, which may lose a cancellation before Python 3.12.
            async with asyncio.timeout(STREAM_TIMEOUT_S):
                await self._websocket.send_text(ENCODER.encode(message).decode())
        except TimeoutError:
            raise TooSlow(
                "gone", "The client read nothing for {limit_s:g} s.", limit_s=STREAM_TIMEOUT_S
            ) from None


def _echoed(options: PlayOptions) -> dict[str, float]:
    """Return the options that the first message repeats."""
    repeated = set(PlayOptions.__struct_fields__) & set(Begin.__struct_fields__)
    return {name: getattr(options, name) for name in repeated}


async def _refuse(websocket: WebSocket, code: int, word: str, detail: str) -> None:
    """Send an error and close the websocket."""
    with contextlib.suppress(RuntimeError, WebSocketDisconnect):
        await websocket.send_text(ENCODER.encode(StreamProblem(code=word, detail=detail)).decode())
    await close(websocket, code, word)
