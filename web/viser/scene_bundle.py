"""Scene bundle: the data of a fold that a browser needs once, before the frames.

The 3D view is viser's own client. viser builds the scene here, the messages that its server would
send are captured, and the page passes them to the client. A view thus needs no viser server, and
the browser computes the frames that follow.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Generator
from typing import TYPE_CHECKING, Any, Final, cast

import msgspec
import numpy as np
import rich
import zstandard
from cachetools import LRUCache, cached
from numpy.typing import NDArray

from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.web.palette import (
    FIRST_MODULE_RGB,
    LAST_MODULE_RGB,
    MAX_ERROR_RGB,
    NO_ERROR_RGB,
    RAMP_COLOURS,
    SELECTED_RGB,
    STALLED_RGB,
    UNKNOWN_ERROR_RGB,
    error_ramp,
    own_colours,
    ramp_colours,
)
from foldback.web.pictures.camera import (
    AZIMUTH_RAD,
    ELEVATION_RAD,
    FIELD_OF_VIEW_RAD,
    ORBIT_SPEED_RAD_S,
)
from foldback.web.pictures.meshes import (
    DISPLAYED_MODULE_SIZE,
    hull_value,
    sketch_outline,
    stud_frames,
)
from foldback.web.pictures.table_top import TableTop
from foldback.web.timeline.columns import encode
from foldback.web.viser.scene import Scene, piece_nodes

if TYPE_CHECKING:
    import viser

_BINARY: Final = "__binary_index"


def bundle_of(chain: Chain, stretch: int | None = None, table: TableTop | None = None) -> bytes:
    """Return the scene bundle of a fold of ``chain``, as one message of ``web.timeline.columns``.

    The header holds the chain's geometry in the terms of ``planner.chain.module``, the scene's
    ``messages`` with ``{"column": name}`` in place of arrays, the outline of the ``sketch``, the
    ``camera``'s constants and the ``colours``. The columns hold these arrays, and the angles and
    positions of the folded chain, ``folded_rad`` and ``folded_positions``.

    Args:
        chain: The chain.
        stretch: Number of straight modules to keep in view; all of them when None.
        table: Table under the chain; None if it floats.
    """
    module, n = chain.module, len(chain)
    joint = module.joint
    pitch, messages, arrays = _staged(chain, stretch, table)
    places, axes = stud_frames(module, n)
    header = {
        "chain": {
            "name": chain.name,
            "module": module.name,
            "root": chain.root,
            "rigid_links": module.rigid_links,
            "hinges": module.hinges_per_joint,
            "kinds": joint.kinds.tolist(),
            "anchor": joint.anchor.tolist(),
            "axes": joint.axes.tolist(),
            "turn": wxyz_from_matrix(joint.turn).tolist(),
            "offset": joint.offset.tolist(),
            **hull_value(module, n),
            "radius": module.radius,
            "hinge_names": list(module.hinge_names),
            # Rounded positions of modules that do not fill cells have no meaning.
            "cells": module.fills_cell,
            "pitch_m": chain.pitch_m,
            # Orientations of module 0 and of the root in the frame of the shape.
            "folded_wxyz": chain.folded_wxyz.tolist(),
            "folded_root_wxyz": chain.folded_poses.wxyzs[chain.root].tolist(),
        },
        "messages": messages,
        "sketch": sketch_outline(module, n),
        "camera": {
            "field_of_view_rad": float(FIELD_OF_VIEW_RAD),
            "azimuth_rad": float(AZIMUTH_RAD),
            "elevation_rad": float(ELEVATION_RAD),
            "turn_rad_s": float(ORBIT_SPEED_RAD_S),
            "stretch": stretch,
        },
        "table": None if table is None else _table_told(table),
        "pitch": pitch,
        "shown_size": DISPLAYED_MODULE_SIZE,
        "nodes": [node.name for node in piece_nodes("/modules", module, n)],
        "ends": [
            {"at": place, "wxyz": turn}
            for place, turn in zip(places.tolist(), wxyz_from_matrix(axes).tolist(), strict=True)
        ],
        "own_colours": own_colours(module, len(module.colours)).tolist(),
        "colours": {
            "neutral": NO_ERROR_RGB,
            "unknown": UNKNOWN_ERROR_RGB,
            "error": MAX_ERROR_RGB,
            "selected": SELECTED_RGB,
            "stuck": STALLED_RGB,
            "first": FIRST_MODULE_RGB,
            "last": LAST_MODULE_RGB,
        },
    }
    columns = {
        **arrays,
        "ramp_error": error_ramp(RAMP_COLOURS),
        "ramp_even": ramp_colours(np.linspace(0.0, 1.0, RAMP_COLOURS)),
        "folded_rad": chain.folded_rad.astype("<f8"),
        "folded_positions": chain.folded_poses.positions.astype("<f4"),
    }
    return encode(header, columns, planes=frozenset(columns))


def opened_scene(record: bytes) -> tuple[list[tuple[float, dict[str, Any]]], list[memoryview]]:
    """Return the messages of a ``.viser`` recording, each with its time, and its buffers."""
    size = int.from_bytes(record[:8], "little")
    raw = zstandard.ZstdDecompressor().decompress(record[8:], max_output_size=size)
    length = int.from_bytes(raw[:8], "little")
    header = cast("dict[str, Any]", msgspec.msgpack.decode(raw[8 : 8 + length]))
    buffers: list[memoryview] = []
    at = 8 + length
    for size in header["binaryBufferLengths"]:
        at += -at % 8
        buffers.append(memoryview(raw)[at : at + size])
        at += size
    return [(float(t), message) for t, message in header["messages"]], buffers


_QUIET_LOCK: Final = threading.RLock()


@contextlib.contextmanager
def quiet() -> Generator[None]:
    """Suppress viser's banner in the terminal, which ``verbose`` does not control."""
    console = rich.get_console()
    with _QUIET_LOCK:
        before, console.quiet = console.quiet, True
        try:
            yield
        finally:
            console.quiet = before


@contextlib.contextmanager
def viser_server() -> Generator[viser.ViserServer]:
    """Run a viser server during the context; only this machine can reach it."""
    import viser  # imported late, so that the service starts faster

    with quiet():
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        yield server
    finally:
        with quiet():
            server.stop()


@contextlib.contextmanager
def viser_scene(
    chain: Chain, stretch: int | None = None, table: TableTop | None = None
) -> Generator[tuple[viser.ViserServer, Scene]]:
    """Run a viser server with the scene of a chain during the context."""
    with viser_server() as server:
        yield server, Scene(server, chain, stretch=stretch, table=table)


def capture_messages(
    server: viser.ViserServer,
) -> tuple[list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Return a server's messages, with ``{"column": name}`` for arrays, and the arrays."""
    messages, buffers = opened_scene(server.get_scene_serializer().serialize())
    arrays: dict[str, NDArray[Any]] = {}

    def named(value: Any) -> Any:
        if isinstance(value, dict):
            header = cast("dict[str, Any]", value)
            if _BINARY in header:
                name = f"buffer_{len(arrays)}"
                arrays[name] = np.frombuffer(buffers[header[_BINARY]], header["dtype"])
                return {"column": name}
            return {k: named(v) for k, v in header.items()}
        if isinstance(value, list | tuple):
            return [named(v) for v in cast("list[Any]", value)]
        return value

    return [named(message) for _, message in messages], arrays


def _table_told(table: TableTop) -> dict[str, Any]:
    """Return the table's data for a page."""
    return {
        "height": table.height,
        "thickness": table.thickness,
        "outline": np.round(table.outline(), 4).tolist(),
    }


def _scene_key(chain: Chain, *place: object) -> tuple[object, ...]:
    """Return the key of a scene, which chains of one module and length share."""
    return (chain.module.name, len(chain), *place)


@cached(LRUCache(64), _scene_key, threading.Lock())
def _staged(
    chain: Chain, stretch: int | None, table: TableTop | None
) -> tuple[float, list[dict[str, Any]], dict[str, NDArray[Any]]]:
    with viser_scene(chain, stretch, table) as (server, scene):
        return scene.pitch, *capture_messages(server)
