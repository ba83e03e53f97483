"""Preview scene: a solid, the cells that stand for it, and the path through them.

Like the scene bundle of a fold, it is built by viser, captured as messages and passed to viser's
client by the page, which shows and hides its layers: ``/solid``, ``/missing``, ``/cells`` and
``/path``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.built_in_modules import DEFAULT_MODULE, module_named, module_of
from foldback.planner.chain.module import Module
from foldback.web.palette import (
    MAX_ERROR_RGB,
    SELECTED_RGB,
    Rgb,
    own_colours,
    ramp_colours,
)
from foldback.web.pictures.camera import FIELD_OF_VIEW_RAD
from foldback.web.pictures.meshes import DISPLAYED_MODULE_SIZE, hull_value, piece_mesh
from foldback.web.timeline.columns import encode
from foldback.web.viser.scene import add_lights, add_meshes, piece_nodes
from foldback.web.viser.scene_bundle import capture_messages, viser_server

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]

SCENE_SIZE: Final = 4.0
"""Length to which the longest side of the shape is scaled in a 3D preview, in units of the viser
scene, so that shapes of all sizes fit into it."""
PATH_WIDTH_PITCH: Final = 0.3
"""Width of the rods that show the chain's path through the cells in a 3D preview, in pitches."""
GHOST_RGB: Final[Rgb] = (110, 120, 134)
GHOST_OPACITY: Final = 0.13
"""Opacity (0 to 1) of the modules in a 3D preview around the chain's path, which remains visible
through them."""


def preview_scene_of(report: Mapping[str, Any]) -> bytes:
    """Return the scene of a preview's report, as one message of ``web.timeline.columns``.

    The header holds the scene's ``messages`` as in ``web.viser.scene_bundle``, a module's ``hull``
    as in ``web.pictures.meshes``, the ``corners`` (8, 3) of the box to keep in view, the
    ``radius`` of a module, the ``camera``, and the ``colours`` of the selected module and of the
    translucent cells around a path (``ghost``). Lengths are in the scene's units: the shape has the
    same size whatever its number of modules. The columns hold the messages' arrays, the ``cells``
    of the modules (n, 3), their ``positions`` (n, 3) and ``wxyzs`` (n, 4) in the scene, and their
    ``colours`` (n, 3) when opaque, sRGB.

    Args:
        report: Full result of ``planner.pipeline.prepare.Preparation.report``.
    """
    with viser_server() as server:
        scene = _PreviewScene(server, report)
        messages, arrays = capture_messages(server)
    header = {
        "messages": messages,
        "hull": hull_value(scene.module, len(scene.positions), unit=scene.unit),
        "corners": scene.corners.tolist(),
        "radius": 0.62 * scene.unit,
        "camera": {
            "field_of_view_rad": float(FIELD_OF_VIEW_RAD),
            "azimuth_rad": float(np.deg2rad(-54.0)),
            "elevation_rad": float(np.deg2rad(26.0)),
            "margin": (0.84, 0.76),
        },
        "colours": {"selected": SELECTED_RGB, "ghost": GHOST_RGB, "ghost_opacity": GHOST_OPACITY},
    }
    cells = np.asarray(report["cells"], dtype="<i4").reshape(-1, 3)
    columns = {
        **arrays,
        "cells": cells,
        "positions": scene.places.astype("<f4"),
        "wxyzs": scene.wxyzs.astype("<f4"),
        "colours": scene.colours,
    }
    return encode(header, columns)


class _PreviewScene:
    """Scene of a preview's report in a viser server."""

    def __init__(self, server: viser.ViserServer, report: Mapping[str, Any]) -> None:
        self._scene = server.scene
        # Without a chain there are only cells.
        chained = report.get("positions") is not None
        cube = module_named(DEFAULT_MODULE)
        self._cell = cube.pieces[0]
        self.module: Module = module_of(report["module_value"]) if chained else cube
        positions = report["positions"] if chained else report["cells"]
        self.positions: Array = np.asarray(positions, dtype=np.float64).reshape(-1, 3)
        count = len(self.positions)
        wxyzs = report.get("wxyzs")
        self.wxyzs: Array = (
            np.tile((1.0, 0.0, 0.0, 0.0), (count, 1)) if wxyzs is None else np.asarray(wxyzs)
        )
        mesh = report.get("mesh")
        repair = {} if report["has_path"] else _repair(report)
        added = report.get("added") or repair.get("add", ())
        self._added = np.asarray(added, dtype=np.float64).reshape(-1, 3)
        self._dropped: list[list[int]] = repair.get("drop", [])
        low, high = _bounds(np.concatenate([self.positions, self._added]), mesh)
        self._middle = (low + high) / 2
        self.unit = SCENE_SIZE / float((high - low).max())
        self.places: Array = self._placed(self.positions)
        inner = self._placed(np.array([low + 0.5, high - 0.5]))
        shares = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        self.corners: Array = inner[0] + shares * (inner[1] - inner[0])
        self.colours: Bytes = own_colours(self.module, count)
        add_lights(server, sky=1.9, shadows=False)
        if count:
            self._draw(report)
        missing = report.get("missing")
        # Without a path, red marks cells that prevent it.
        if report["has_path"] and missing is not None and len(missing["faces"]):
            self._scene.add_mesh_simple(
                "/missing",
                self._placed(np.asarray(missing["vertices"], dtype=np.float64)),
                np.asarray(missing["faces"], dtype=np.int64),
                color=MAX_ERROR_RGB,
                opacity=0.6,
                flat_shading=False,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
        if mesh is not None and len(mesh["faces"]):
            self._scene.add_mesh_simple(
                "/solid",
                self._placed(np.asarray(mesh["vertices"], dtype=np.float64)),
                np.asarray(mesh["faces"], dtype=np.int64),
                color=(92, 120, 164),
                opacity=0.34 if report["has_path"] else 0.1,
                flat_shading=False,
                side="front",
                cast_shadow=False,
                receive_shadow=False,
            )

    def _draw(self, report: Mapping[str, Any]) -> None:
        if report["has_path"]:
            self.colours = ramp_colours(np.linspace(0.0, 1.0, len(self.positions)))
            # Opaque modules would hide the path, so they are translucent.
            ghost = np.tile(np.array(GHOST_RGB, np.uint8), (len(self.positions), 1))
            self._modules("/cells", ghost, opacity=GHOST_OPACITY)
            line = np.asarray(report["line"], dtype=np.float64)
            self._path(line, ramp_colours(np.linspace(0.0, 1.0, len(line))))
            self._show_added()
        else:
            self._mark(report)
            self._modules("/cells", self.colours)
        # The page moves the one of the selected module's piece to it.
        blue = np.array([SELECTED_RGB], np.uint8)
        for node in piece_nodes("/selected", self.module, len(self.positions)):
            first = node.members[:1]
            add_meshes(
                self._scene,
                node.name,
                piece_mesh(node.piece),
                blue,
                self.places[first],
                self.wxyzs[first],
                self.unit,
                visible=False,
            )

    def _mark(self, report: Mapping[str, Any]) -> None:
        """Mark the cells that prevent a path, and those that the repair removes or adds."""
        state = report.get("feasibility") or {}
        index = {tuple(map(int, cell)): k for k, cell in enumerate(self.positions)}
        bad = [cell for problem in state.get("problems", ()) for cell in problem["cells"]]
        for cell in [*bad, *self._dropped]:
            if (k := index.get(tuple(cell))) is not None:
                self.colours[k] = MAX_ERROR_RGB
        self._show_added()

    def _show_added(self) -> None:
        """Draw the cells that a repair adds, or has added."""
        if len(self._added):
            blue = np.tile(np.array(SELECTED_RGB, np.uint8), (len(self._added), 1))
            self._cubes("/added", self._added, blue, opacity=0.55)

    def _path(self, cells: Array, colours: Bytes) -> None:
        self._scene.add_frame("/path", show_axes=False)
        steps = np.diff(cells, axis=0)
        middles = (cells[1:] + cells[:-1]) / 2
        axes = np.abs(steps).argmax(axis=1)
        mixed = ((colours[1:].astype(np.float64) + colours[:-1]) / 2).astype(np.uint8)
        oblique = np.abs(np.abs(steps) - np.eye(3)[axes]).max(axis=1) > 1e-3  # rounded to 1e-4
        if oblique.any():
            self._oblique_rods(middles[oblique], mixed[oblique], steps[oblique])
        for axis in range(3):
            along = (axes == axis) & ~oblique
            if along.any():
                sides = np.full(3, PATH_WIDTH_PITCH)
                sides[axis] = 1.0
                self._cubes(f"/path/rods{axis}", middles[along], mixed[along], sides)
        sizes = np.full(len(cells), PATH_WIDTH_PITCH * 1.06)
        sizes[[0, -1]] = 0.46 * 1.3
        self._cubes("/path/beads", cells, colours, batched_scales=sizes.astype(np.float32))

    def _oblique_rods(self, middles: Array, colours: Bytes, steps: Array) -> None:
        """Add the rods of a path for steps that are not of one pitch along an axis."""
        lengths = np.linalg.norm(steps, axis=1)
        # The half-way quaternion between the x axis and each direction; a rod has no sense.
        x, y, z = steps.T / lengths * np.where(steps[:, 0] < 0.0, -1.0, 1.0)
        turns = np.column_stack([1.0 + x, np.zeros(len(x)), -z, y])
        self._cubes(
            "/path/rods",
            middles,
            colours,
            np.array([1.0, PATH_WIDTH_PITCH, PATH_WIDTH_PITCH]),
            wxyzs=turns / np.linalg.norm(turns, axis=1)[:, None],
            batched_scales=np.column_stack([lengths, np.ones((len(lengths), 2))]),
        )

    def _modules(
        self, name: str, colours: Bytes, *, opacity: float | None = None, visible: bool = True
    ) -> None:
        """Add the first modules of the folded chain, one for each colour."""
        for node in piece_nodes(name, self.module, len(colours)):
            add_meshes(
                self._scene,
                node.name,
                piece_mesh(node.piece),
                colours[node.members],
                self.places[node.members],
                self.wxyzs[node.members],
                self.unit,
                opacity=opacity,
                visible=visible,
            )

    def _cubes(
        self,
        name: str,
        cells: Array,
        colours: Bytes,
        sides: float | Array = DISPLAYED_MODULE_SIZE,
        **options: Any,
    ) -> None:
        """Add cuboids with sides in pitches."""
        scale = self.unit * sides / DISPLAYED_MODULE_SIZE
        places = self._placed(cells)
        add_meshes(
            self._scene, name, piece_mesh(self._cell), colours, places, scale=scale, **options
        )

    def _placed(self, points: Array) -> Array:
        return (points - self._middle) * self.unit


def _repair(report: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the first repair; empty if there is none."""
    state = report.get("feasibility") or {}
    return next(iter(state.get("repairs", ())), {})


def _bounds(cells: Array, mesh: Mapping[str, Any] | None) -> tuple[Array, Array]:
    """Return the lowest and the highest corner of the box around cells and solid."""
    vertices = np.asarray([] if mesh is None else mesh["vertices"], dtype=np.float64)
    points = np.concatenate([cells - 0.5, cells + 0.5, vertices.reshape(-1, 3)])
    if not len(points):
        points = np.array([[-0.5] * 3, [0.5] * 3])
    return points.min(axis=0), points.max(axis=0)
