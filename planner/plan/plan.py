"""Plan: chain, record, playback, certificate, and everything needed to repeat them."""

from __future__ import annotations

import json
import platform
import zlib
from base64 import b64decode, b64encode
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path as FilePath
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array
from foldback.planner.certificate.certificate import Certificate
from foldback.planner.certificate.figures import CertificateFigures
from foldback.planner.chain.built_in_modules import described_words
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_attributes, chain_from_attributes
from foldback.planner.errors import UNREADABLE, InputError, named
from foldback.planner.explosion.diagnosis import stuck_of
from foldback.planner.motion.angle_encoding import (
    MAX_PLAIN_ANGLES,
    PLANES_NAME,
    Planes,
    encode_frames,
    encode_windows,
    plane_metadata,
    to_step_counts,
    with_plain_angles,
)
from foldback.planner.motion.motion import FRAME_COLUMNS, PHASES, WINDOW_COLUMNS, Columns, Motion
from foldback.planner.motion.record import Record
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.plan.claim import claim_of
from foldback.planner.plan.rests import rest_frames
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.unfolding import MAX_ANGLE_DIFFERENCE_RAD, Unfolding
from foldback.planner.shapes.likeness import Likeness
from foldback.planner.storage.array_files import save_npz
from foldback.planner.storage.files import write_whole
from foldback.planner.storage.plain_values import array_from, from_plain

PLAN_FORMAT: Final = "foldback-plan/3"
MAX_DENSE_ANGLES: Final = 2**25
"""Maximum number of joint angles (frames × hinges) of a plan that are held in one array (256 MiB);
a longer plan of windows (moving sections of the chain) is refused where all angles are needed."""
DEFLATE_LEVEL: Final = 6
"""Compression level of a plan's files, from 1 to 9."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """Folding motion of a straight chain, frame by frame, with its certificate.

    Attributes:
        chain: The chain.
        preset: Name of the parameter set.
        parameters: All parameters, as plain values.
        seed: Random seed.
        versions: Versions of the programs that computed it.
        start: The chain as it is folded at the beginning of a refold; None when it is straight.
        motion: F snapshots from straight to folded, of a refold from the start on: what the hinges
            should be, the pose as simulated. Dense or windowed.
        max_error_rad: (F,) largest joint error of the simulated playback; NaN, in JSON null, where
            there was no simulation.
        explosion: Status, reason, steps, frames and seconds of the explosion; None without one.
        playback: Status, reason, steps, seconds and errors of the playback; None without one.
        certificate: Certificate of the plan.
        attempts: Every explosion that was tried, the last one is the record.
        smoothing: Changes by smoothing, see ``planner.smoothing.smoothed_plan``; None of a recorded
            plan.
        likeness: Likeness of the folded modules to the input; None if the input was a path or a
            chain.
    """

    chain: Chain
    preset: str
    parameters: dict[str, Any]
    seed: int
    versions: dict[str, str]
    motion: Motion
    max_error_rad: Array
    explosion: dict[str, Any] | None
    playback: dict[str, Any] | None
    certificate: Certificate
    attempts: tuple[dict[str, Any], ...] = ()
    start: Chain | None = None
    smoothing: dict[str, Any] | None = None
    likeness: Likeness | None = None

    @classmethod
    def assembled(
        cls,
        chain: Chain,
        parameters: Parameters,
        seed: int,
        record: Record | None,
        playback: Playback | None,
        certificate: Certificate,
        attempts: tuple[dict[str, Any], ...] = (),
    ) -> Plan:
        """Return a plan from the results of the stages."""
        motion, errors = Motion.empty(len(chain.folded_rad)), np.zeros(0)
        if playback is not None:
            motion, errors = playback.reference, playback.frames.largest_errors
            if parameters.world == "table":
                is_clamped = parameters.table.held
                motion = playback.frames.planned(chain, motion, clamped=is_clamped)
            motion = replace(motion, time_s=motion.time_s - motion.time_s[0])
        return cls(
            chain=chain,
            preset=parameters.preset,
            parameters=parameters.as_dict(),
            seed=seed,
            versions=versions(),
            motion=motion,
            max_error_rad=errors,
            explosion=None if record is None else record.summary(),
            playback=None if playback is None else playback.summary(),
            certificate=certificate,
            attempts=attempts,
        )

    @property
    def time_s(self) -> Array:
        """(F,) simulated time, from 0 on."""
        return self.motion.time_s

    @property
    def phase(self) -> NDArray[np.uint8]:
        """(F,) index into ``PHASES``: ``playback``, before a refold is straight ``unfolding``."""
        return self.motion.phase

    @property
    def joint_angles_rad(self) -> Array:
        """(F, J) what the hinges should be.

        Raises:
            InputError: ``plan-too-long`` when those of all frames together are too many.
        """
        return self.whole().joint_angles_rad

    @property
    def root_position(self) -> Array:
        """(F, 3) centre of the root module in pitches."""
        return self.whole().root_position

    @property
    def root_wxyz(self) -> Array:
        """(F, 4) its orientation."""
        return self.whole().root_wxyz

    def part(self, start: int, stop: int) -> Motion:
        """Return some frames with all their angles."""
        return self.motion.dense(self.chain, start, stop)

    def whole(self) -> Motion:
        """Return all frames with all their angles.

        Raises:
            InputError: ``plan-too-long`` when they are too many.
        """
        if not self.motion.is_windowed:
            return self.motion
        count = len(self.motion) * len(self.chain.folded_rad)
        if count > MAX_DENSE_ANGLES:
            raise InputError(
                "plan-too-long",
                f"got {count} joint angles ({len(self.motion)} frames of "
                f"{len(self.chain.folded_rad)} hinges), expected at most {MAX_DENSE_ANGLES}; use "
                "plan.npz, which stores only the angles of hinges that are neither folded nor "
                "straight.",
            )
        return self.motion.dense(self.chain)

    def unfolding(self) -> Unfolding:
        """Return the unfolding motion; of a refold, that of its second half.

        Raises:
            InputError: ``refold-not-folded`` when it does not lead from straight to folded.
        """
        folding = self.phase == PHASES.index("playback")
        angles, times = self.joint_angles_rad[folding], self.time_s[folding]
        if not (
            len(angles) > 1
            and np.isfinite(angles).all()
            and np.isfinite(times).all()
            and (np.diff(times) >= 0.0).all()
            and np.abs(angles[0]).max() <= MAX_ANGLE_DIFFERENCE_RAD
            and np.abs(angles[-1] - self.chain.folded_rad).max() <= MAX_ANGLE_DIFFERENCE_RAD
        ):
            raise InputError(
                "refold-not-folded",
                f"got a plan of {self.chain.name} that does not start straight and end folded, "
                "expected a plan that starts straight and ends folded; fold the shape again with "
                "another seed or preset.",
            )
        begins = int(np.argmax(folding))
        rests = tuple(k - begins for k in rest_frames(self.playback) if k >= begins)
        if len(rests) == 1:  # where the turns of an unfolding ended, before this motion
            rests = ()
        return Unfolding(
            chain=self.chain, time_s=times - times[0], folding_rad=angles, rest_frames=rests
        )

    @property
    def verified(self) -> bool:
        """True if the certificate verifies the plan."""
        return self.certificate.verified

    def summary(self) -> dict[str, Any]:
        """Return the figures of the plan without its frames."""
        nothing = {"steps": 0, "frames": 0, "seconds": 0.0}
        return {
            "status": "verified" if self.verified else "failed",
            "reason": self.certificate.reason.text() if self.certificate.reason else "",
            "name": self.chain.name,
            "module": self.chain.module.name,
            "module_words": described_words(self.chain.module),
            "modules": len(self.chain),
            "joints": self.chain.joint_count,
            "hinges": len(self.chain.folded_rad),
            "preset": self.preset,
            "seed": self.seed,
            "refold": self._refold(),
            "smoothing": self.smoothing,
            "likeness": None if self.likeness is None else self.likeness.as_dict(),
            "stuck": stuck_of(self.explosion, self.attempts),
            "attempts": len(self.attempts),
            "explosion": self.explosion or nothing,
            "playback": self.playback,
            "certificate": self.certificate.as_dict(),
        }

    def _refold(self) -> dict[str, Any] | None:
        """Return the start of a refold and when it is straight; None of other plans."""
        if self.start is None:
            return None
        straight = int((self.phase == PHASES.index("unfolding")).sum())
        return {
            "start": self.start.name,
            "straight_frame": straight,
            "straight_s": float(self.time_s[straight]) if straight < len(self.time_s) else None,
            "frames": len(self.time_s),
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the plan as plain JSON values."""
        columns, planes = self._columns()
        values: dict[str, Any] = {**self.rest(), "joint_names": list(self.chain.joint_names)}
        if planes is not None:
            data = b64encode(zlib.compress(planes.tobytes(), DEFLATE_LEVEL)).decode()
            values["angles"]["data"] = data
        return {**values, **{name: _listed(column) for name, column in columns.items()}}

    def rest(self) -> dict[str, Any]:
        """Return all but the joints' names and the frames, as plain JSON values."""
        motion = self.motion
        angles = motion.stored_angles_rad
        return {
            "format": PLAN_FORMAT,
            "motion": motion.layout,
            "chain": chain_attributes(self.chain),
            "start": None if self.start is None else chain_attributes(self.start),
            "preset": self.preset,
            "parameters": self.parameters,
            "seed": self.seed,
            "versions": self.versions,
            "attempts": list(self.attempts),
            "smoothing": self.smoothing,
            "likeness": None if self.likeness is None else self.likeness.as_dict(),
            "explosion": self.explosion,
            "playback": self.playback,
            "certificate": self.certificate.as_dict(),
            "claim": claim_of(self.chain.module, motion),
            "root_module": self.chain.root,
            "angles": (
                None
                if to_step_counts(angles) is None
                else plane_metadata(angles.shape, windowed=motion.is_windowed)
            ),
        }

    def _columns(self) -> tuple[dict[str, NDArray[Any]], Planes | None]:
        """Return the arrays with a value a frame, by name; angles apart if in planes."""
        motion = self.motion
        names, stored = _columns_of(motion.layout), motion.columns()
        columns = {
            "phase": np.array([PHASES[index] for index in self.phase.tolist()], dtype="<U16"),
            **{name: stored[name] for name in names},
            "max_error_rad": self.max_error_rad,
        }
        angles = next(name for name in names if name.endswith("angles_rad"))
        if columns[angles].size <= MAX_PLAIN_ANGLES:
            return columns, None
        if motion.is_windowed:
            planes = encode_windows(
                motion.first, motion.offsets, motion.angles_rad, self.chain.folded_rad
            )
        else:
            planes = encode_frames(motion.joint_angles_rad)
        if planes is not None:
            del columns[angles]
        return columns, planes

    def save_json(self, path: FilePath) -> None:
        """Write the JSON form; the file is either whole or not there."""
        write_whole(path, self.json_bytes())

    def json_bytes(self) -> bytes:
        """Return the JSON form as text."""
        return json.dumps(self.as_dict(), separators=(",", ":")).encode()

    def save_npz(self, path: FilePath, *, durable: bool = False) -> None:
        """Write the arrays, with all else as JSON text in ``plan``; no pickle is needed.

        Args:
            path: Path of the file.
            durable: Flush the file to the disk, so that it survives a power cut.
        """
        save_npz(path, self.npz_arrays(), level=DEFLATE_LEVEL, durable=durable)

    def npz_arrays(self) -> dict[str, Any]:
        """Return the arrays of the ``.npz`` form by name."""
        columns, planes = self._columns()
        return {
            "plan": np.array(json.dumps(self.rest())),
            "joint_names": np.array(self.chain.joint_names),
            **columns,
            **({} if planes is None else {PLANES_NAME: planes}),
        }

    def as_stored(self) -> Plan:
        """Return the plan as ``load`` reads it from its file."""
        arrays = self.npz_arrays()
        values = json.loads(str(arrays.pop("plan")))
        return self.of_values(values | arrays, "plan")

    def with_joint_errors_of(self, playback: Playback | None) -> Plan:
        """Return the plan with the joint errors of its playback, which its file leaves out."""
        if playback is None:
            return self
        motion = replace(self.motion, errors_rad=playback.frames.errors_rad)
        return replace(self, motion=motion)

    @classmethod
    def load(cls, path: FilePath) -> Plan:
        """Read a plan from its JSON or ``.npz`` form.

        Raises:
            InputError: ``not-a-plan``, ``wrong-format``.
        """
        return cls.of_values(read_values(path), path.name)

    @classmethod
    def of_values(cls, values: dict[str, Any], name: str) -> Plan:
        """Return the plan that a file holds.

        Args:
            values: From ``read_values``.
            name: Name of the file.

        Raises:
            InputError: ``not-a-plan``, ``wrong-format``.
        """
        try:
            if values["format"] != PLAN_FORMAT:
                raise InputError(
                    "wrong-format",
                    f"got the format {values['format']!r} in {name}, expected {PLAN_FORMAT!r}; "
                    "fold the shape again, or read the plan with the version of foldback that "
                    "wrote it.",
                )
            stored = from_plain(values, _PlanValues)
            chain = chain_from_attributes(stored.chain)
            motion, errors = _read_motion(values, chain)
            return cls(
                chain=chain,
                motion=motion,
                max_error_rad=errors,
                certificate=Certificate.from_dict(cast("CertificateFigures", stored.certificate)),
                start=None if stored.start is None else chain_from_attributes(stored.start),
                **{k: getattr(stored, k) for k in _VALUES},
            )
        except InputError as error:
            raise named(error, name) from None
        except UNREADABLE as error:
            raise _unreadable(name, error) from error


def read_values(path: FilePath) -> dict[str, Any]:
    """Return a plan file's values by name: JSON values, and the arrays of an ``.npz`` file.

    Raises:
        InputError: ``not-a-plan``.
    """
    try:
        if path.suffix == ".npz":
            # NumPy leaves a file open that it opened itself and cannot read.
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                values = from_plain(json.loads(str(file["plan"])), dict[str, Any])
                return values | {name: file[name] for name in file.files if name != "plan"}
        return from_plain(json.loads(path.read_bytes()), dict[str, Any])
    except UNREADABLE as error:
        raise _unreadable(path.name, error) from error


def _unreadable(name: str, error: Exception) -> InputError:
    return InputError("not-a-plan", f"{name} contains no readable plan ({error}).")


@dataclass(frozen=True, slots=True, kw_only=True)
class _PlanValues:
    """Values of a plan's file but for the frames, with the types that are read."""

    motion: str
    chain: dict[str, Any]
    certificate: dict[str, Any]
    preset: str
    parameters: dict[str, Any]
    seed: int
    versions: dict[str, str]
    explosion: dict[str, Any] | None
    playback: dict[str, Any] | None
    attempts: tuple[dict[str, Any], ...]
    start: dict[str, Any] | None
    smoothing: dict[str, Any] | None
    likeness: Likeness | None
    angles: dict[str, Any] | None = None


_VALUES: Final = (
    *("preset", "parameters", "seed", "versions", "explosion", "playback"),
    *("attempts", "smoothing", "likeness"),
)


def _columns_of(layout: str) -> Columns:
    """Return the columns of a motion that a plan has as they are: all but phase and errors."""
    columns = WINDOW_COLUMNS if layout == "windows" else FRAME_COLUMNS
    excluded = ("phase", "joint_error_rad", "errors_rad")
    return {name: column for name, column in columns.items() if name not in excluded}


def _unpacked(values: dict[str, Any], layout: str, chain: Chain) -> dict[str, Any]:
    """Return a plan's values, with angles that are stored in planes as plain numbers."""
    metadata = values.get("angles") or {}
    if "data" in metadata:
        if PLANES_NAME in values:
            raise ValueError(
                f"got the angles twice, in {PLANES_NAME} and in angles.data, expected them once"
            )
        planes = np.frombuffer(zlib.decompress(b64decode(metadata["data"])), np.uint8).reshape(
            4, -1
        )
        values = {**values, PLANES_NAME: planes}
    return with_plain_angles(values, metadata, chain.folded_rad, windowed=layout == "windows")


def _read_motion(values: dict[str, Any], chain: Chain) -> tuple[Motion, Array]:
    """Return the motion and the largest errors among a plan's values."""
    layout = values["motion"]
    if layout not in ("frames", "windows"):
        raise ValueError(f"got the motion layout {layout!r}, expected frames or windows")
    values = _unpacked(values, layout, chain)
    hinges = len(chain.folded_rad)
    arrays: dict[str, Any] = {
        name: array_from(values[name], dtype).reshape(
            -1, *(hinges if length < 0 else length for length in tail)
        )
        for name, (tail, dtype) in _columns_of(layout).items()
    }
    arrays["phase"] = np.array(
        [PHASES.index(str(name)) for name in array_from(values["phase"], object).reshape(-1)],
        dtype=np.uint8,
    )
    errors = array_from(values["max_error_rad"], np.float64).reshape(-1)
    counts = {name: len(array) for name, array in arrays.items() if name != "angles_rad"}
    counts["max_error_rad"] = len(errors)
    if "offsets" in counts:
        counts["offsets"] -= 1
    if len(set(counts.values())) > 1:
        raise ValueError(f"the plan's arrays have different numbers of frames: {counts}")
    motion = Motion.from_columns(arrays)
    if motion.is_windowed:
        try:
            motion.check(chain)
        except InputError as error:
            raise ValueError(error.detail) from error
    return motion, errors


def versions() -> dict[str, str]:
    """Versions of what a plan depends on."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    installed = {"python": platform.python_version()}
    for package in ("foldback", "mujoco", "numpy", "scipy"):
        try:
            installed[package] = version(package)
        except PackageNotFoundError:
            installed[package] = "unknown"
    return installed


def _listed(array: NDArray[Any]) -> Any:
    """Plain JSON values that are read back as the same numbers."""
    if array.dtype.kind != "f":
        return array.tolist()
    exact = array.astype(np.float64)
    if array.ndim == 1 and np.isnan(exact).any():
        return [None if np.isnan(value) else value for value in exact.tolist()]
    return exact.tolist()
