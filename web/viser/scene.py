"""Scene: a chain of modules in one viser server, built with viser's public names only."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Ints
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module, Piece
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.web.palette import FIRST_MODULE_RGB, LAST_MODULE_RGB, instance_colours, ramp_colours
from foldback.web.pictures.camera import FIELD_OF_VIEW_RAD, GROUND_GAP_PITCH
from foldback.web.pictures.meshes import Mesh, piece_mesh, stud_mesh, stud_poses
from foldback.web.pictures.table_top import TABLE_RGB, TableTop, disc_mesh
from foldback.web.timeline.view import Snapshot

if TYPE_CHECKING:
    import viser

Array = NDArray[np.float64]

TABLE_NODES: Final = ("/table", "/pressed")
"""Names of the nodes of a table and of the discs on it; the page's scripts use them, too."""
SHADOWS: Final = {"cast_shadow": True, "receive_shadow": True}
"""Options of viser for meshes that cast and receive shadows."""


def path_colours(modules: int) -> NDArray[np.uint8]:
    """Return (modules - 1, 2, 3) sRGB bytes of the ends of a path's segments, in order."""
    along = ramp_colours(np.linspace(0.0, 1.0, modules))
    return np.stack([along[:-1], along[1:]], axis=1)


def add_lights(server: viser.ViserServer, *, sky: float, shadows: bool) -> None:
    """Add viser's default lights, a neutral sky of the given intensity and a side light."""
    scene = server.scene
    scene.set_up_direction("+z")
    scene.configure_default_lights(True, cast_shadow=shadows)
    scene.configure_environment_map(None)
    scene.add_light_hemisphere(
        "/sky", sky_color=(255, 255, 255), ground_color=(176, 170, 160), intensity=sky
    )
    scene.add_light_directional(
        "/side", color=(255, 250, 242), intensity=0.9, position=(-0.3, -1.0, 0.5)
    )
    server.initial_camera.fov = FIELD_OF_VIEW_RAD


def add_meshes(
    scene: viser.SceneApi,
    name: str,
    mesh: Mesh,
    colours: NDArray[np.uint8],
    positions: Array,
    wxyzs: Array | None = None,
    scale: float | Array = 1.0,
    **options: Any,
) -> viser.BatchedMeshHandle:
    """Add a mesh at each of (n, 3) positions.

    Args:
        scene: Scene of a viser server.
        name: Name of the node.
        mesh: The mesh.
        colours: (n, 3) sRGB bytes.
        positions: (n, 3) positions.
        wxyzs: (n, 4) orientations; by default all are upright.
        scale: Factor on the mesh, or (3,) factors along its axes.
        options: Other options of viser; by default there are no shadows.
    """
    if wxyzs is None:
        wxyzs = np.tile([1.0, 0.0, 0.0, 0.0], (len(positions), 1))
    options = {"cast_shadow": False, "receive_shadow": False, **options}
    return scene.add_batched_meshes_simple(
        name,
        mesh.vertices * scale,
        mesh.faces,
        wxyzs,
        positions,
        batched_colors=instance_colours(colours),
        lod="off",
        **options,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PieceNode:
    """Node that shows all modules of a chain that are one of the module's pieces.

    Attributes:
        name: Name of the node.
        piece: The piece.
        members: (m,) numbers of the modules, in order.
    """

    name: str
    piece: Piece
    members: Ints


def piece_nodes(name: str, module: Module, modules: int) -> list[PieceNode]:
    """Return the nodes that show a chain: one for each of the module's pieces in it."""
    numbers = np.resize(module.piece_numbers, modules)
    return [
        PieceNode(
            name=f"{name}_{k}" if k else name, piece=piece, members=np.flatnonzero(numbers == k)
        )
        for k, piece in enumerate(module.pieces)
        if k in numbers
    ]


def _black(modules: int) -> NDArray[np.uint8]:
    """Return black for each of some modules, until its colour is known."""
    return np.zeros((modules, 3), np.uint8)


class Scene:
    """Scene of one chain; it draws snapshots and reports clicked modules."""

    def __init__(
        self,
        server: viser.ViserServer,
        chain: Chain,
        *,
        stretch: int | None = None,
        table: TableTop | None = None,
    ) -> None:
        """Build the scene.

        Args:
            server: The viser server.
            chain: The chain.
            stretch: Number of straight modules to keep in view; all of them when None.
            table: Table under the chain; None if it floats.
        """
        self._server = server
        self._chain = chain
        # and the folded part beside it
        span = len(chain) if stretch is None else min(len(chain), 3 * stretch)
        self.pitch = min(0.25, 14.0 / span)  # viser's shadows reach 20 units from the camera
        self._ground: float | None = None
        self._last: Snapshot | None = None
        self._table = table
        add_lights(server, sky=1.7, shadows=True)
        self._modules = [
            (
                node.members,
                self._add_copies(
                    node.name, piece_mesh(node.piece), _black(len(node.members)), **SHADOWS
                ),
            )
            for node in piece_nodes("/modules", chain.module, len(chain))
        ]
        ends = np.array([FIRST_MODULE_RGB, LAST_MODULE_RGB], np.uint8)
        self._ends = self._add_copies("/ends", stud_mesh(), ends)
        self._add_path()
        self._floor = server.scene.add_grid(
            "/ground",
            width=60.0,
            height=60.0,
            cell_thickness=0.0,
            section_thickness=0.0,
            cell_size=100.0,
            section_size=100.0,
            shadow_opacity=0.16,
            fade_distance=40.0,
            visible=table is None,
        )
        if table is not None:
            self._add_table(table)

    def _add_copies(
        self, name: str, mesh: Mesh, colours: NDArray[np.uint8], **options: Any
    ) -> viser.BatchedMeshHandle:
        """Add a copy of a mesh at the origin for each of (n, 3) sRGB colours."""
        at = np.zeros((len(colours), 3))
        return add_meshes(self._server.scene, name, mesh, colours, at, scale=self.pitch, **options)

    def _add_path(self) -> None:
        """Add the line through the modules' centres, hidden at first."""
        n = len(self._chain)
        self._server.scene.add_line_segments(
            "/path",
            np.zeros((n - 1, 2, 3), np.float32),
            instance_colours(path_colours(n)),
            thickness=0.18 * self.pitch,
            visible=False,
        )

    def _add_table(self, table: TableTop) -> None:
        """Add the table, and for each module a disc on it that shows its force on the table."""
        slab = table.mesh()
        self._server.scene.add_mesh_simple(
            TABLE_NODES[0],
            slab.vertices * self.pitch,
            slab.faces,
            color=TABLE_RGB,
            flat_shading=True,
            side="double",
            cast_shadow=False,
            receive_shadow=True,
        )
        self._add_copies(
            TABLE_NODES[1],
            disc_mesh(),
            _black(len(self._chain)),
            batched_scales=np.zeros(len(self._chain), np.float32),
            opacity=0.85,
            side="double",
            visible=False,
        )

    def remove_table(self) -> None:
        """Remove the table, if any; a new scene on the same server replaces all other nodes."""
        if self._table is not None:
            for name in TABLE_NODES:
                self._server.scene.remove_by_name(name)

    def show(self, snapshot: Snapshot, colours: NDArray[np.uint8]) -> None:
        """Draw a snapshot with modules in (n, 3) sRGB bytes, as one update for all clients."""
        self._last = snapshot
        with self._server.atomic():
            for members, handle in self._modules:
                handle.batched_positions = snapshot.positions[members] * np.float32(self.pitch)
                handle.batched_wxyzs = snapshot.wxyzs[members]
                handle.batched_colors = instance_colours(colours[members])
            self._place_ends(snapshot)

    def on_click(self, clicked: Callable[[int], None]) -> None:
        """Call ``clicked`` with the number of each module that is clicked."""
        for members, handle in self._modules:

            def report(
                event: viser.SceneNodePointerEvent[viser.BatchedMeshHandle],
                members: NDArray[np.int64] = members,
            ) -> None:
                # Clients may send invalid numbers.
                if event.instance_index is not None and 0 <= event.instance_index < len(members):
                    clicked(int(members[event.instance_index]))

            handle.on_click(report)

    def points(self, snapshot: Snapshot) -> Array:
        """Return the (m, 3) centres of the modules to keep in view, in the scene's units."""
        return snapshot.positions[: snapshot.framed].astype(np.float64) * self.pitch

    @property
    def radius(self) -> float:
        """Radius of a module in the scene's units."""
        return self._chain.module.radius * self.pitch

    def _place_ends(self, snapshot: Snapshot) -> None:
        centres, wxyzs = (
            values[[0, -1]].astype(np.float64) for values in (snapshot.positions, snapshot.wxyzs)
        )
        positions, turns = stud_poses(self._chain.module, len(self._chain), centres, wxyzs)
        self._ends.batched_positions = (positions * self.pitch).astype(np.float32)
        self._ends.batched_wxyzs = wxyz_from_matrix(turns).astype(np.float32)

    def move_ground(self, seconds: float) -> None:
        """Let the ground follow the chain for ``seconds`` of playing time."""
        if self._last is None or self._table is not None:
            return
        positions = self._last.positions[: self._last.framed]
        low = (float(positions[:, 2].min()) - 0.5 - GROUND_GAP_PITCH) * self.pitch
        before = low if self._ground is None else self._ground
        # faster down than up
        after = low + (before - low) * math.exp(-seconds / (0.05 if low < before else 0.5))
        if self._ground is not None and abs(after - self._ground) < 1e-3 * self.pitch:
            return
        self._ground = after
        middle = positions.mean(axis=0) * self.pitch
        self._floor.position = (float(middle[0]), float(middle[1]), self._ground)
