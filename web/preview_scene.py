"""Preview scene: a solid, the cells that stand for it, and the path through them, in viser."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import viser
from numpy.typing import NDArray
from viser._messages import SetCameraLookAtMessage, SetCameraPositionMessage

from planner.modules import CUBE, Module, module_named
from web.camera import FIELD_OF_VIEW_RAD, View
from web.colours import ERROR, NEUTRAL, SELECTED, Rgb, instance_colours, ramp_colours
from web.meshes import module_mesh
from web.picking import picked_module
from web.scene import broadcast

Array = NDArray[np.float64]

SIZE: Final = 4.0
"""Longest side of what is shown, in the scene's units."""
ROD: Final = 0.3
BEAD: Final = 0.46
SOLID: Final[Rgb] = (92, 120, 164)
GHOST: Final[Rgb] = (110, 120, 134)
GHOST_OPACITY: Final = 0.13
SOLID_OPACITY: Final = 0.34
AZIMUTH_RAD: Final = np.deg2rad(-54.0)
ELEVATION_RAD: Final = np.deg2rad(26.0)
UPRIGHT: Final = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Layers:
    """What is shown."""

    solid: bool = True
    cells: bool = True
    path: bool = True


class PreviewScene:
    """Draws the report of a preview; the same size whatever the number of modules."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._handles: dict[str, Any] = {}
        self._report: Mapping[str, Any] | None = None
        self._module: Module = CUBE
        self._positions: Array = np.zeros((0, 3))
        self._wxyzs: Array = np.zeros((0, 4))
        self._middle: Array = np.zeros(3)
        self._unit = 1.0
        self.points: Array = np.zeros((1, 3))
        self.radius = 0.5
        scene = server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(True, cast_shadow=False)
        scene.configure_environment_map(None)
        scene.add_light_hemisphere(
            "/sky", sky_color=(255, 255, 255), ground_color=(176, 170, 160), intensity=1.9
        )
        scene.add_light_directional(
            "/side", color=(255, 250, 242), intensity=0.9, position=(-0.3, -1.0, 0.5)
        )
        server.initial_camera.fov = FIELD_OF_VIEW_RAD

    def show(self, report: Mapping[str, Any], layers: Layers) -> None:
        """Draws a report, in place of the one before."""
        self._report = report
        # Without a chain there are only cells, which are cubes.
        chained = report.get("positions") is not None
        self._module = module_named(report["module"]) if chained else CUBE
        cells = report["positions"] if chained else report["cells"]
        cells = np.asarray(cells, dtype=np.float64).reshape(-1, 3)
        wxyzs = report.get("wxyzs")
        self._positions = cells
        self._wxyzs = np.tile(UPRIGHT, (len(cells), 1)) if wxyzs is None else np.asarray(wxyzs)
        mesh = report.get("mesh")
        low, high = _bounds(cells, mesh)
        self._middle = (low + high) / 2
        self._unit = SIZE / float((high - low).max())
        self.points = self._placed(np.array([low + 0.5, high - 0.5]))
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        self.points = self.points[0] + corners * (self.points[1] - self.points[0])
        self.radius = 0.62 * self._unit
        with self._server.atomic():
            for handle in self._handles.values():
                handle.remove()
            self._handles.clear()
            if len(cells):
                self._draw(report, cells, layers)
            if mesh is not None and len(mesh["faces"]):
                self._handles["solid"] = self._server.scene.add_mesh_simple(
                    "/solid",
                    self._placed(np.asarray(mesh["vertices"], dtype=np.float64)),
                    np.asarray(mesh["faces"], dtype=np.int64),
                    color=SOLID,
                    opacity=SOLID_OPACITY,
                    flat_shading=False,
                    side="front",
                    cast_shadow=False,
                    receive_shadow=False,
                    visible=layers.solid,
                )

    def on_pick(self, told: Callable[[int | None], None]) -> None:
        """Calls ``told`` with the index of a cell that is clicked, None for a click beside."""

        @self._server.scene.on_click()
        def _(event: viser.SceneClickEvent) -> None:
            if self._report is not None and len(self._positions):
                told(
                    picked_module(
                        self._module,
                        self._positions,
                        self._wxyzs,
                        np.array(event.ray_origin) / self._unit + self._middle,
                        np.array(event.ray_direction),
                    )
                )

    def select(self, cell: int | None) -> None:
        """Highlights one cell, or none."""
        handle = self._handles.pop("selected", None)
        if handle is not None:
            handle.remove()
        if cell is not None:
            blue = np.array([SELECTED], np.uint8)
            self._modules("selected", blue, visible=True, only=slice(cell, cell + 1))

    def look(self, view: View) -> None:
        """Moves the camera of all who look."""
        with self._server.atomic():
            x, y, z = (float(v) for v in view.position)
            broadcast(self._server, SetCameraPositionMessage((x, y, z)))
            x, y, z = (float(v) for v in view.target)
            broadcast(self._server, SetCameraLookAtMessage((x, y, z)))

    def _draw(self, report: Mapping[str, Any], cells: Array, layers: Layers) -> None:
        colours = ramp_colours(np.linspace(0.0, 1.0, len(cells)))
        if not report["has_path"]:
            colours = np.tile(np.array(NEUTRAL, np.uint8), (len(cells), 1))
            self._mark(report, cells, colours)
            self._modules("cells", colours, visible=layers.cells or layers.path)
            return
        # A path inside full modules would not be seen: they become a ghost around it.
        ghost = layers.path
        shown = np.tile(np.array(GHOST, np.uint8), (len(cells), 1)) if ghost else colours
        opacity = GHOST_OPACITY if ghost else None
        self._modules("cells", shown, opacity=opacity, visible=layers.cells)
        if layers.path:
            line = np.asarray(report["line"], dtype=np.float64)
            self._path(line, ramp_colours(np.linspace(0.0, 1.0, len(line))))

    def _mark(self, report: Mapping[str, Any], cells: Array, colours: NDArray[np.uint8]) -> None:
        """Cells that make trouble, and those that the repair would add, stand out."""
        state = report.get("feasibility") or {}
        index = {tuple(map(int, cell)): k for k, cell in enumerate(cells)}
        for problem in state.get("problems", ()):
            for cell in problem["cells"]:
                if (k := index.get(tuple(cell))) is not None:
                    colours[k] = ERROR
        for repair in state.get("repairs", ())[:1]:
            added = np.asarray(repair["add"], dtype=np.float64).reshape(-1, 3)
            for cell in repair["drop"]:
                if (k := index.get(tuple(cell))) is not None:
                    colours[k] = ERROR
            if len(added):
                blue = np.tile(np.array(SELECTED, np.uint8), (len(added), 1))
                self._cubes("added", added, blue, opacity=0.55, visible=True)

    def _path(self, cells: Array, colours: NDArray[np.uint8]) -> None:
        steps = np.diff(cells, axis=0)
        middles = (cells[1:] + cells[:-1]) / 2
        axes = np.abs(steps).argmax(axis=1)
        mixed = (colours[1:].astype(np.float64) + colours[:-1]) / 2
        for axis in range(3):
            along = axes == axis
            if not along.any():
                continue
            sides = np.full(3, ROD)
            sides[axis] = 1.0
            self._cubes(
                f"rods{axis}",
                middles[along],
                mixed[along].astype(np.uint8),
                sides=sides,
                visible=True,
            )
        sizes = np.full(len(cells), ROD * 1.06)
        sizes[[0, -1]] = BEAD * 1.3
        self._cubes("beads", cells, colours, scales=sizes, visible=True)

    def _modules(
        self,
        name: str,
        colours: NDArray[np.uint8],
        *,
        visible: bool,
        opacity: float | None = None,
        only: slice = slice(None),
    ) -> None:
        """The modules of the chain, or some of them, where they are when folded."""
        mesh = module_mesh(self._module)
        self._handles[name] = self._server.scene.add_batched_meshes_simple(
            f"/{name}",
            mesh.vertices * self._unit,
            mesh.faces,
            self._wxyzs[only],
            self._placed(self._positions[only]),
            batched_colors=instance_colours(colours),
            opacity=opacity,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
            visible=visible,
        )

    def _cubes(
        self,
        name: str,
        cells: Array,
        colours: NDArray[np.uint8],
        *,
        visible: bool,
        opacity: float | None = None,
        sides: Array | None = None,
        scales: Array | None = None,
    ) -> None:
        cube = module_mesh(CUBE)
        vertices = cube.vertices * self._unit
        self._handles[name] = self._server.scene.add_batched_meshes_simple(
            f"/{name}",
            vertices if sides is None else vertices * sides / 0.93,
            cube.faces,
            np.tile(UPRIGHT, (len(cells), 1)),
            self._placed(cells),
            batched_colors=instance_colours(colours),
            batched_scales=None if scales is None else scales.astype(np.float32),
            opacity=opacity,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
            visible=visible,
        )

    def _placed(self, points: Array) -> Array:
        return (points - self._middle) * self._unit


def _bounds(cells: Array, mesh: Mapping[str, Any] | None) -> tuple[Array, Array]:
    """The corners of the box around cells and solid."""
    lows, highs = [np.full(3, np.inf)], [np.full(3, -np.inf)]
    if len(cells):
        lows.append(cells.min(axis=0) - 0.5)
        highs.append(cells.max(axis=0) + 0.5)
    if mesh is not None and len(mesh["vertices"]):
        vertices = np.asarray(mesh["vertices"], dtype=np.float64)
        lows.append(vertices.min(axis=0))
        highs.append(vertices.max(axis=0))
    if len(lows) == 1:
        return np.full(3, -0.5), np.full(3, 0.5)
    return np.min(lows, axis=0), np.max(highs, axis=0)


__all__ = ["AZIMUTH_RAD", "ELEVATION_RAD", "Layers", "PreviewScene"]
