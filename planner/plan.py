"""Plan: chain, record, playback, certificate, and everything needed to repeat them."""

from __future__ import annotations

import json
import platform
import zlib
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path as FilePath
from typing import Any, Final
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from planner.certificate import Certificate
from planner.chain import Chain
from planner.errors import InputError
from planner.files import write_whole
from planner.parameters import Parameters
from planner.playback import Playback
from planner.record import Record, save_npz
from planner.timeline import PHASES, chain_attributes, chain_from_attributes

Array = NDArray[np.float64]
FORMAT: Final = "foldback-plan/1"
DIGITS: Final = 12
"""Decimals of angles and positions in the JSON form; the ``.npz`` form has them all."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """How a straight chain folds, frame by frame, and what was verified of it.

    Attributes:
        chain: The chain.
        preset: Name of the parameter set.
        parameters: All parameters, as plain values.
        seed: What randomness started from.
        versions: Of the programs that made it.
        start: The chain as it is folded at the beginning of a refold; None when it is straight.
        time_s: (F,) simulated time from straight to folded; of a refold from the start on.
        phase: (F,) uint8 index into ``planner.timeline.PHASES``: ``playback``, and ``unfolding``
            until a refold is straight.
        joint_angles_rad: (F, J) what the hinges should be.
        root_position: (F, 3) centre of the root module in the simulated playback, in pitches.
        root_wxyz: (F, 4) its orientation.
        max_error_rad: (F,) largest joint error of the simulated playback; NaN, in JSON null, where
            there was no simulation.
        explosion: Status, reason, steps, frames and seconds of the explosion; None without one.
        playback: Status, reason, steps, seconds and errors of the playback; None without one.
        certificate: What was verified.
        attempts: Every explosion that was tried, the last one is the record.
    """

    chain: Chain
    preset: str
    parameters: dict[str, Any]
    seed: int
    versions: dict[str, str]
    time_s: Array
    phase: NDArray[np.uint8]
    joint_angles_rad: Array
    root_position: Array
    root_wxyz: Array
    max_error_rad: Array
    explosion: dict[str, Any] | None
    playback: dict[str, Any] | None
    certificate: Certificate
    attempts: tuple[dict[str, Any], ...] = ()
    start: Chain | None = None

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
        start: Chain | None = None,
    ) -> Plan:
        """A plan from the results of the stages."""
        joints = len(chain.folded_rad)
        frames = None if playback is None else playback.frames
        return cls(
            chain=chain,
            preset=parameters.preset,
            parameters=parameters.as_dict(),
            seed=seed,
            versions=versions(),
            time_s=np.zeros(0) if frames is None else frames.time_s - frames.time_s[0],
            phase=np.zeros(0, dtype=np.uint8) if frames is None else frames.phase,
            joint_angles_rad=np.zeros((0, joints)) if playback is None else playback.reference_rad,
            root_position=np.zeros((0, 3)) if frames is None else frames.root_position,
            root_wxyz=np.zeros((0, 4)) if frames is None else frames.root_wxyz,
            max_error_rad=np.zeros(0) if frames is None else frames.joint_error_rad.max(axis=1),
            explosion=None if record is None else record.summary(),
            playback=None if playback is None else playback.summary(),
            certificate=certificate,
            attempts=attempts,
            start=start,
        )

    @property
    def verified(self) -> bool:
        """Whether the certificate says that the plan may be trusted."""
        return self.certificate.verified

    def summary(self) -> dict[str, Any]:
        """The figures of the plan without its frames."""
        nothing = {"steps": 0, "frames": 0, "seconds": 0.0}
        return {
            "status": "verified" if self.verified else "failed",
            "reason": "" if self.verified else self.certificate.verdict.removeprefix("failed: "),
            "name": self.chain.name,
            "module": self.chain.module.name,
            "modules": len(self.chain),
            "joints": self.chain.joint_count,
            "hinges": len(self.chain.folded_rad),
            "preset": self.preset,
            "seed": self.seed,
            "refold": self._refold(),
            "explosion": self.explosion or nothing,
            "playback": self.playback,
            "certificate": self.certificate.as_dict(),
        }

    def _refold(self) -> dict[str, Any] | None:
        """Of a refold: what it begins folded as, and when it is straight."""
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
        """The plan as ``foldback-plan/1``, plain JSON values."""
        return {
            "format": FORMAT,
            "chain": chain_attributes(self.chain),
            "start": None if self.start is None else chain_attributes(self.start),
            "preset": self.preset,
            "parameters": self.parameters,
            "seed": self.seed,
            "versions": self.versions,
            "attempts": list(self.attempts),
            "explosion": self.explosion,
            "playback": self.playback,
            "certificate": self.certificate.as_dict(),
            "root_module": self.chain.root,
            "joint_names": list(self.chain.joint_names),
            "time_s": _listed(self.time_s),
            "phase": [PHASES[index] for index in self.phase.tolist()],
            "joint_angles_rad": _listed(self.joint_angles_rad),
            "root_position": _listed(self.root_position),
            "root_wxyz": _listed(self.root_wxyz),
            "max_error_rad": _listed(self.max_error_rad),
        }

    def save_json(self, path: FilePath) -> None:
        """Writes the JSON form; the file is either whole or not there."""
        write_whole(path, self.json_bytes())

    def json_bytes(self) -> bytes:
        """The JSON form as text."""
        return json.dumps(self.as_dict(), separators=(",", ":")).encode()

    def save_npz(self, path: FilePath) -> None:
        """Writes the arrays, with all else as JSON text in ``plan``; needs no pickle to read."""
        save_npz(path, self.npz_arrays())

    def npz_arrays(self) -> dict[str, Any]:
        """What the ``.npz`` form holds, by name."""
        rest = {k: v for k, v in self.as_dict().items() if k not in _ARRAYS and k != "phase"}
        return {
            "plan": np.array(json.dumps(rest)),
            "phase": np.array([PHASES[index] for index in self.phase.tolist()], dtype="<U16"),
            "joint_names": np.array(self.chain.joint_names),
            **{name: getattr(self, name) for name in _ARRAYS},
        }

    @classmethod
    def load(cls, path: FilePath) -> Plan:
        """Reads a plan from its JSON or ``.npz`` form.

        Raises:
            InputError: ``not-a-plan``.
        """
        try:
            if path.suffix == ".npz":
                # NumPy leaves a file open that it opened itself and cannot read.
                with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                    values = json.loads(str(file["plan"]))
                    values.update({name: file[name] for name in (*_ARRAYS, "phase")})
            else:
                values = json.loads(path.read_bytes())
            if values["format"] != FORMAT:
                raise InputError(
                    "wrong-format",
                    f"got the format {values['format']!r} in {path.name}, expected {FORMAT!r}.",
                )
            chain = chain_from_attributes(values["chain"])
            shapes = {
                "time_s": (-1,),
                "max_error_rad": (-1,),
                "joint_angles_rad": (-1, len(chain.folded_rad)),
                "root_position": (-1, 3),
                "root_wxyz": (-1, 4),
            }
            arrays: dict[str, Any] = {
                name: np.asarray(values[name], dtype=np.float64).reshape(shape)
                for name, shape in shapes.items()
            }
            arrays["phase"] = np.array(
                [PHASES.index(str(name)) for name in values["phase"]], dtype=np.uint8
            )
            counts = {name: len(array) for name, array in arrays.items()}
            if len(set(counts.values())) > 1:
                raise ValueError(f"its arrays differ in their numbers of frames: {counts}")
            return cls(
                chain=chain,
                certificate=Certificate.from_dict(values["certificate"]),
                attempts=tuple(values.get("attempts", ())),
                start=chain_from_attributes(start) if (start := values.get("start")) else None,
                **{k: values[k] for k in _VALUES},
                **arrays,
            )
        except _UNREADABLE as error:
            raise InputError(
                "not-a-plan", f"{path.name} holds no plan that can be read ({error})."
            ) from error


_UNREADABLE: Final = (
    OSError,
    EOFError,
    KeyError,
    TypeError,
    ValueError,
    RecursionError,
    BadZipFile,
    zlib.error,
)
_ARRAYS: Final = ("time_s", "joint_angles_rad", "root_position", "root_wxyz", "max_error_rad")
_VALUES: Final = (
    "preset",
    "parameters",
    "seed",
    "versions",
    "explosion",
    "playback",
)


def versions() -> dict[str, str]:
    """Versions of what a plan depends on."""
    found = {"python": platform.python_version()}
    for package in ("foldback", "mujoco", "numpy", "numba", "scipy"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def _listed(array: Array) -> Any:
    if array.ndim == 1 and np.isnan(array).any():
        return [None if np.isnan(value) else value for value in np.round(array, DIGITS).tolist()]
    return np.round(array, DIGITS).tolist()
