"""GLB: the fold as an animated scene (glTF 2.0, binary), in metres, y up.

A node a module, all of one mesh, below one node that turns the planner's z axis up. Each module is
moved by a translation and a rotation channel over common keyframes; at rest it is folded.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module, Piece
from foldback.planner.exports.export import export_name, require_frames, rising
from foldback.planner.exports.stl import piece_mesh
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.steps import find_steps

Single = NDArray[np.float32]
MIN_KEYFRAME_TOLERANCE: Final = 3e-3
"""Smallest tolerance that is tried for the difference between a GLB animation, interpolated between
keyframes, and the plan, in pitches and in components of unit quaternions; it is doubled until all
keyframes take at most 32 MiB."""
MAX_KEYFRAME_BYTES: Final = 32 * 2**20
"""Maximum size of all keyframes of a GLB file, in bytes; an animation that needs more gets fewer
keyframes and follows the plan less closely."""
POSE_BYTES_SINGLE: Final = 28
"""Size of one module's pose in a GLB animation, in bytes: position and quaternion, seven numbers of
single precision."""
MAX_POSES_AT_ONCE: Final = 200_000
"""Maximum number of module poses (frames × modules) that are computed at once to write a GLB
animation."""
GL_ARRAY_BUFFER: Final = 34962
"""Code for binary data with vertex attributes in a glTF file (``bufferView.target`` in the glTF 2.0
specification)."""
Z_UP_TO_Y_UP_XYZW: Final = (-float(np.sqrt(0.5)), 0.0, 0.0, float(np.sqrt(0.5)))
"""Rotation from the planner's frame (z up) to glTF's (y up): −90° about x, as a quaternion (x, y,
z, w)."""
SRGB_GAMMA: Final = 2.2
"""Exponent by which colour values of a display become linear, as glTF has them."""
MATERIAL: Final[dict[str, Any]] = {
    "name": "module",
    "pbrMetallicRoughness": {
        "baseColorFactor": (0.8, 0.36, 0.11, 1.0),
        "metallicFactor": 0.0,
        "roughnessFactor": 0.6,
    },
}
"""Material of the modules in a GLB file, as glTF 2.0 describes it: matt orange (linear RGBA from 0
to 1)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Track:
    """K snapshots of all n modules.

    Attributes:
        time_s: (K,) strictly rising, in single precision too.
        positions: (K, n, 3) centres in pitches.
        wxyzs: (K, n, 4) unit quaternions, each in the half space of the one before.
        tolerance: Largest deviation of a frame of the plan from the track between snapshots.
    """

    time_s: Array
    positions: Single
    wxyzs: Single
    tolerance: float


@dataclass(slots=True)
class Buffer:
    """The binary part of a file and the JSON that points into it."""

    data: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    accessors: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])

    def add(self, values: Single, *, target: int | None = None) -> list[int]:
        """Add (A, K, …) values in one view; A accessors of K elements each."""
        view: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": len(self.data),
            "byteLength": values.nbytes,
        }
        if target is not None:
            view["target"] = target
        self.views.append(view)
        self.data += values.tobytes()
        kind = "SCALAR" if values.ndim == 2 else f"VEC{values.shape[2]}"
        first = len(self.accessors)
        for k, part in enumerate(values):
            accessor: dict[str, Any] = {
                "bufferView": len(self.views) - 1,
                "byteOffset": k * part.nbytes,
                "componentType": 5126,  # FLOAT
                "count": len(part),
                "type": kind,
            }
            # Asked for by the format, of times and of the mesh's corners.
            if kind == "SCALAR" or target is not None:
                accessor["min"] = np.atleast_1d(part.min(axis=0)).tolist()
                accessor["max"] = np.atleast_1d(part.max(axis=0)).tolist()
            self.accessors.append(accessor)
        return list(range(first, len(self.accessors)))


def write(plan: Plan) -> bytes:
    """Return the fold as one GLB file.

    Raises:
        InputError: ``no-frames``.
    """
    require_frames(plan)
    chain = plan.chain
    track = track_of(plan)
    places = np.ascontiguousarray(
        (track.positions.astype(np.float64) * chain.pitch_m).swapaxes(0, 1), dtype="<f4"
    )
    # glTF puts w last.
    turns = np.ascontiguousarray(np.roll(track.wxyzs, -1, axis=-1).swapaxes(0, 1), dtype="<f4")
    edge = plan.certificate.module_size * chain.pitch_m
    buffer = Buffer()
    attributes = [_add_piece(buffer, piece, edge) for piece in chain.module.pieces]
    looks = _looks(chain)
    (times,) = buffer.add(track.time_s.astype("<f4")[None])
    outputs = list(zip(buffer.add(places), buffer.add(turns), strict=True))
    document: dict[str, Any] = {
        "asset": _asset(plan, track),
        "scene": 0,
        "scenes": [{"nodes": [len(chain)]}],
        "nodes": _nodes(chain, places, turns, looks),
        "meshes": [
            {
                "name": f"{chain.module.name}_{k}" if k else chain.module.name,
                "primitives": [{"attributes": attributes[piece], "material": material}],
            }
            for k, (piece, material) in enumerate(dict.fromkeys(looks))
        ],
        "materials": _materials(chain.module),
        "animations": [_animation(times, outputs, plan)],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{"byteLength": len(buffer.data)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    return _packed(text, bytes(buffer.data))


def _asset(plan: Plan, track: Track) -> dict[str, Any]:
    pitch_m = plan.chain.pitch_m
    return {
        "version": "2.0",
        "generator": "foldback",
        "extras": {
            "pitch_m": pitch_m,
            "module": plan.chain.module.name,
            "verdict": export_name(plan.certificate.verdict),
            "keyframes": len(track.time_s),
            "tolerance_m": track.tolerance * pitch_m,
        },
    }


def _add_piece(buffer: Buffer, piece: Piece, size: float) -> dict[str, int]:
    """Add the triangles of a piece; return the accessors of their corners and normals."""
    mesh = piece_mesh(piece, size)
    corners = mesh.triangles.reshape(1, -1, 3).astype("<f4")
    normals = np.repeat(mesh.face_normals, 3, axis=0)[None].astype("<f4")
    (position,) = buffer.add(corners, target=GL_ARRAY_BUFFER)
    (normal,) = buffer.add(normals, target=GL_ARRAY_BUFFER)
    return {"POSITION": position, "NORMAL": normal}


def _looks(chain: Chain) -> list[tuple[int, int]]:
    """Return the numbers of each module's piece and material."""
    pattern, colours = chain.module.pattern, max(1, len(chain.module.colours))
    return [(pattern[i % len(pattern)], i % colours) for i in range(len(chain))]


def _materials(module: Module) -> list[dict[str, Any]]:
    """Return the materials of a module's own colours, or the usual one."""
    surface = MATERIAL["pbrMetallicRoughness"]
    bytes_of = [bytes.fromhex(colour.removeprefix("#")) for colour in module.colours]
    linear = [[round((v / 255.0) ** SRGB_GAMMA, 4) for v in colour] for colour in bytes_of]
    return [
        {**MATERIAL, "pbrMetallicRoughness": {**surface, "baseColorFactor": [*colour, 1.0]}}
        for colour in linear
    ] or [MATERIAL]


def _nodes(
    chain: Chain, places: Single, turns: Single, looks: list[tuple[int, int]]
) -> list[dict[str, Any]]:
    """Return a node for each module, where it is in the end, and one that holds them upright."""
    meshes = {look: k for k, look in enumerate(dict.fromkeys(looks))}
    nodes: list[dict[str, Any]] = [
        {
            "name": f"module_{i}",
            "mesh": meshes[looks[i]],
            "translation": places[i, -1].tolist(),
            "rotation": turns[i, -1].tolist(),
        }
        for i in range(len(chain))
    ]
    top = {
        "name": export_name(chain.name),
        "rotation": Z_UP_TO_Y_UP_XYZW,
        "children": [*range(len(chain))],
    }
    return [*nodes, top]


def _animation(times: int, outputs: list[tuple[int, int]], plan: Plan) -> dict[str, Any]:
    """Return the animation of all modules; its ``extras`` mark the steps of a plan that rests.

    Args:
        times: Accessor of the keyframes' times.
        outputs: Accessors of each module's translations and rotations.
        plan: The plan.
    """
    samplers = [
        {"input": times, "output": output, "interpolation": "LINEAR"}
        for pair in outputs
        for output in pair
    ]
    channels = [
        {"sampler": 2 * i + k, "target": {"node": i, "path": path}}
        for i in range(len(outputs))
        for k, path in enumerate(("translation", "rotation"))
    ]
    animation: dict[str, Any] = {"name": "fold", "samplers": samplers, "channels": channels}
    steps = find_steps(plan)
    if steps is not None:
        animation["extras"] = {
            "steps": [
                {"name": f"Step {number}", "start_s": start, "end_s": end}
                for number, (start, end) in enumerate(pairwise(steps.times_s), 1)
            ]
        }
    return animation


def track_of(plan: Plan) -> Track:
    """Return a limited number of keyframes that, joined by lines and slerps, follow the plan."""
    modules = len(plan.chain)
    rising_frames = rising(plan.time_s.astype(np.float32))
    max_keyframes = max(2, MAX_KEYFRAME_BYTES // (modules * POSE_BYTES_SINGLE))
    # What is looked at fits into memory; of many frames, some are passed over from the outset.
    sampled = rising_frames[:: -(-len(rising_frames) // (4 * max_keyframes))]
    if sampled[-1] != rising_frames[-1]:
        sampled = np.append(sampled, rising_frames[-1])
    track = _all_of(plan, sampled)
    tolerance = MIN_KEYFRAME_TOLERANCE
    while len(keys := keyframes(track, tolerance)) > max_keyframes:
        tolerance *= 2.0
    thinned = Track(
        time_s=track.time_s[keys],
        positions=track.positions[keys],
        wxyzs=track.wxyzs[keys],
        tolerance=tolerance,
    )
    if len(sampled) == len(plan.time_s):
        return thinned
    return replace(thinned, tolerance=max(tolerance, _largest_error(plan, thinned)))


def keyframes(track: Track, tolerance: float) -> list[int]:
    """Return the frames to store, from first to last, as few as the tolerance permits."""
    keys = [0]
    last = len(track.time_s) - 1
    while keys[-1] < last:
        stop = keys[-1] + 1
        while stop < last and _error_between(track, keys[-1], stop + 1) <= tolerance:
            stop += 1
        keys.append(stop)
    return keys


def _error_between(track: Track, start: int, stop: int) -> float:
    """Return the largest deviation of the frames between two from their line and arc."""
    inside = slice(start + 1, stop)
    span = track.time_s[stop] - track.time_s[start]
    u = ((track.time_s[inside] - track.time_s[start]) / span).astype(np.float32)[:, None, None]
    places, turns = _between(track, start, stop, u)
    off = np.linalg.norm(places - track.positions[inside], axis=-1).max()
    return float(max(off, np.linalg.norm(turns - track.wxyzs[inside], axis=-1).max()))


def _largest_error(plan: Plan, track: Track) -> float:
    """Return how far frames of a plan are from the lines and arcs between keyframes, in pitches."""
    largest = 0.0
    times = track.time_s.astype(np.float32)
    step = max(1, MAX_POSES_AT_ONCE // len(plan.chain))
    for k in range(0, len(plan.time_s), step):
        frames = _all_of(plan, np.arange(k, min(k + step, len(plan.time_s))))
        stop = np.minimum(np.searchsorted(times, frames.time_s), len(times) - 1)
        start = np.maximum(stop - 1, 0)
        span = np.where(stop > start, times[stop] - times[start], 1.0)
        u = np.clip((frames.time_s - times[start]) / span, 0.0, 1.0)
        places, turns = _between(track, start, stop, u.astype(np.float32)[:, None, None])
        off = np.linalg.norm(places - frames.positions, axis=-1).max()
        sign = np.where((turns * frames.wxyzs).sum(axis=-1) < 0, -1.0, 1.0)[..., None]
        turned = np.linalg.norm(turns - sign * frames.wxyzs, axis=-1).max()
        largest = max(largest, float(off), float(turned))
    return largest


def _between(track: Track, start: int | Ints, stop: int | Ints, u: Single) -> tuple[Single, Single]:
    """Return positions and quaternions at the fractions (F, 1, 1) between snapshots."""
    places = (1 - u) * track.positions[start] + u * track.positions[stop]
    cosine = np.clip((track.wxyzs[start] * track.wxyzs[stop]).sum(axis=-1), -1.0, 1.0)
    angle = np.arccos(cosine)[..., None]
    near = angle < 1e-3
    sine = np.where(near, 1.0, np.sin(angle))
    first = np.where(near, 1 - u, np.sin((1 - u) * angle) / sine)
    second = np.where(near, u, np.sin(u * angle) / sine)
    return places, first * track.wxyzs[start] + second * track.wxyzs[stop]


def _all_of(plan: Plan, frames: Ints) -> Track:
    modules = len(plan.chain)
    positions = np.empty((len(frames), modules, 3), dtype=np.float32)
    wxyzs = np.empty((len(frames), modules, 4), dtype=np.float32)
    step = max(1, MAX_POSES_AT_ONCE // modules)
    for k in range(0, len(frames), step):
        poses = plan.motion[frames[k : k + step]].poses(plan.chain)
        positions[k : k + step], wxyzs[k : k + step] = poses.positions, poses.wxyzs
    # q and −q are one orientation, but the way between two is long if their signs differ.
    turned = (wxyzs[1:] * wxyzs[:-1]).sum(axis=-1) < 0
    wxyzs[1:][np.cumsum(turned, axis=0) % 2 == 1] *= -1.0
    return Track(time_s=plan.time_s[frames], positions=positions, wxyzs=wxyzs, tolerance=0.0)


def _packed(text: bytes, binary: bytes) -> bytes:
    """Return a GLB file: its header, the JSON chunk and the binary chunk."""
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    length = 12 + 8 + len(text) + 8 + len(binary)
    return b"".join(
        (
            struct.pack("<4sII", b"glTF", 2, length),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", len(binary), b"BIN\x00"),
            binary,
        )
    )
