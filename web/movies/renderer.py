"""Renderer of movies: a chain drawn offscreen by MuJoCo, in the style of the page.

Nothing is simulated: the modules in MuJoCo's scene get the poses of the timeline.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Ints
from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import matrix_from_wxyz
from foldback.planner.simulation.lazy_mujoco import mujoco
from foldback.web.palette import FIRST_MODULE_RGB, LAST_MODULE_RGB
from foldback.web.pictures.camera import FIELD_OF_VIEW_RAD, View
from foldback.web.pictures.ground_shadow import SHADOW_CELLS, ground_shadow
from foldback.web.pictures.lighting import (
    SHADOW_SHIFT_PER_HEIGHT,
    Theme,
    fill_light,
    key_light,
    shade_colours,
    share_left,
)
from foldback.web.pictures.meshes import stud_mesh
from foldback.web.pictures.module_faces import drawn_faces

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]


class NoGLError(Exception):
    """No OpenGL is available that can draw without a screen."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shot:
    """Content of one picture.

    Attributes:
        numbers: (m,) numbers of the modules that are drawn.
        positions: (m, 3) centres in pitches of these modules.
        wxyzs: (m, 4) orientations of these modules.
        colours: (m, 3) sRGB bytes.
        ends: (2, 3) positions of the studs on the first and on the last module.
        end_turns: (2, 3, 3) orientations of the studs.
        view: The camera, in pitches.
        ground: Height of the ground.
    """

    numbers: Ints
    positions: Array
    wxyzs: Array
    colours: NDArray[np.uint8]
    ends: Array
    end_turns: Array
    view: View
    ground: float


class MovieRenderer:
    """OpenGL context with the drawn chain; use it in one thread and close it there."""

    def __init__(
        self, module: Module, modules: int, *, width: int, height: int, theme: Theme, backend: str
    ) -> None:
        """Open an offscreen window.

        Args:
            module: The kind of module.
            modules: Maximum number of drawn modules.
            width: Width of a picture in pixels.
            height: Height of a picture in pixels.
            theme: Colours of the ground and the lights.
            backend: ``egl`` or ``osmesa``.

        Raises:
            NoGLError: If this backend cannot draw on this machine.
        """
        self._theme = theme
        self._module = module
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._picture = np.empty((height, width, 3), np.uint8)
        self._model = _model(module, self._theme, width=width, height=height)
        self._gl = _context(backend, width, height)
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_50)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        counts = [len(drawn_faces(piece)) for piece in module.pieces]
        self._scene = mujoco.MjvScene(self._model, maxgeom=modules * max(counts) + 4)
        self._scene.flags[:] = 0
        self._counts = np.array(counts)
        self._first = np.cumsum([0, *counts])  # mesh of each piece, and of the studs
        # MuJoCo moves each mesh to an inertial frame; these are its poses in the original frames.
        self._mesh_at = self._model.mesh_pos.copy()
        self._mesh_turn = matrix_from_wxyz(self._model.mesh_quat)
        self._ends = [self._mesh(sum(counts)) for _ in range(2)]
        for end, colour in zip(self._ends, (FIRST_MODULE_RGB, LAST_MODULE_RGB), strict=True):
            end.rgba[:3] = np.array(colour) / 255.0
        self._planes = self._plane(0), self._plane(1)
        # They come last, so that a picture can leave out those that it does not need.
        self._before = self._scene.ngeom
        self._faces = [self._mesh(0) for _ in range(modules * max(counts))]

    def __enter__(self) -> MovieRenderer:
        return self

    def __exit__(self, *of: object) -> None:
        self._context.free()
        self._gl.free()

    def draw(self, shot: Shot) -> Picture:
        """Return (H, W, 3) sRGB bytes, from the top; the array is reused."""
        turns = matrix_from_wxyz(shot.wxyzs)
        self._place_modules(shot, turns)
        self._place_ends(shot)
        self._place_ground(shot)
        self._light(shot.view)
        self._look(shot.view)
        mujoco.mjr_render(self._rectangle, self._scene, self._context)
        mujoco.mjr_readPixels(self._picture, None, self._rectangle, self._context)
        return self._picture[::-1]

    def _geom(self, kind: Any, size: Array) -> Any:
        scene = self._scene
        geom = scene.geoms[scene.ngeom]
        scene.ngeom += 1
        mujoco.mjv_initGeom(
            geom, kind, size, np.zeros(3), np.eye(3).ravel(), np.ones(4, np.float32)
        )
        return geom

    def _mesh(self, mesh: int) -> Any:
        geom = self._geom(mujoco.mjtGeom.mjGEOM_MESH, np.ones(3))
        geom.dataid = 2 * mesh
        geom.specular, geom.shininess = 0.16, 0.35
        return geom

    def _plane(self, material: int) -> Any:
        geom = self._geom(mujoco.mjtGeom.mjGEOM_PLANE, np.ones(3))
        geom.matid = material
        # It emits its texture at full brightness, so that the lights do not change it.
        geom.emission, geom.specular = 1.0, 0.0
        return geom

    def _place_modules(self, shot: Shot, turns: Array) -> None:
        module = self._module
        free_share = share_left(
            module, shot.numbers, shot.positions, turns, view=shot.view, theme=self._theme
        )
        pieces = module.piece_numbers[shot.numbers % len(module.pattern)]
        counts = self._counts[pieces]
        rows = np.repeat(np.arange(len(counts)), counts)
        face = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
        mesh = self._first[pieces[rows]] + face
        colours = shot.colours[rows] / np.float32(255.0) * free_share[rows, face, None]
        at = np.einsum("nij,nj->ni", turns[rows], self._mesh_at[mesh]) + shot.positions[rows]
        turned = turns[rows] @ self._mesh_turn[mesh]
        self._scene.ngeom = self._before + len(rows)
        for k, geom in enumerate(self._faces[: len(rows)]):
            geom.dataid = 2 * mesh[k]
            geom.pos, geom.mat = at[k], turned[k]
            geom.rgba[:3] = colours[k]

    def _place_ends(self, shot: Shot) -> None:
        for geom, position, turn in zip(self._ends, shot.ends, shot.end_turns, strict=True):
            geom.pos = position + turn @ self._mesh_at[-1]
            geom.mat = turn @ self._mesh_turn[-1]

    def _place_ground(self, shot: Shot) -> None:
        shadow = ground_shadow(
            shot.positions,
            ground=shot.ground,
            lean=-SHADOW_SHIFT_PER_HEIGHT * key_light(shot.view)[:2],
        )
        self._paint(shade_colours(shadow, self._theme))
        half = shadow.side / 2
        shade, ground = self._planes
        shade.pos = (*shadow.middle, shot.ground)
        shade.size = (half, half, 1.0)
        far = 60.0 * shot.view.distance
        ground.pos = (*shadow.middle, shot.ground - 4e-4 * shot.view.distance)
        ground.size = (far, far, 1.0)

    def _paint(self, colours: Picture) -> None:
        at = int(self._model.tex_adr[0])
        self._model.tex_data[at : at + colours.size] = colours[::-1].reshape(-1)
        mujoco.mjr_uploadTexture(self._model, self._context, 0)

    def _light(self, view: View) -> None:
        theme, scene = self._theme, self._scene
        scene.nlight = 2
        key, fill = scene.lights[0], scene.lights[1]
        _shine(key, key_light(view), theme.key_colour)
        key.specular = [0.25] * 3
        _shine(fill, fill_light(view), theme.fill * np.ones(3))
        fill.ambient = [theme.ambient] * 3

    def _look(self, view: View) -> None:
        _, up, out = view.axes
        near = 0.02 * view.distance
        half = near * float(np.tan(FIELD_OF_VIEW_RAD / 2))
        for camera in self._scene.camera:
            camera.pos, camera.forward, camera.up = view.position, -out, up
            camera.frustum_near, camera.frustum_far = near, 40.0 * view.distance
            camera.frustum_bottom, camera.frustum_top = -half, half
            camera.frustum_center = 0.0


def _shine(light: Any, towards: Array, diffuse: Array) -> None:
    light.type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    light.dir = -towards
    light.attenuation = (1.0, 0.0, 0.0)
    light.ambient = light.specular = (0.0, 0.0, 0.0)
    light.diffuse = diffuse
    light.headlight, light.castshadow, light.texid = 0, 0, -1


def _model(module: Module, theme: Theme, *, width: int, height: int) -> Any:
    """Return a model that contains only what is drawn: meshes and textures."""
    spec = mujoco.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.offsamples = 4
    spec.visual.headlight.active = 0
    faces = [face for piece in module.pieces for face in drawn_faces(piece)]
    for k, face in enumerate(faces):
        added = _add_mesh(spec, f"face_{k}", face.vertices, face.triangles)
        added.usernormal = face.normals.ravel()
    stud = stud_mesh()
    _add_mesh(spec, "end", stud.vertices, stud.faces)
    for name, cells in (("shade", SHADOW_CELLS), ("ground", 2)):
        texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D)
        texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
        texture.width = texture.height = cells
        texture.rgb1 = texture.rgb2 = np.array(theme.ground) / 255.0
        material = spec.add_material(name=name)
        material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    return spec.compile()


def _add_mesh(spec: Any, name: str, vertices: Array, triangles: NDArray[np.int64]) -> Any:
    added = spec.add_mesh(name=name)
    added.uservert, added.userface = vertices.ravel(), triangles.ravel()
    added.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
    return added


def _context(backend: str, width: int, height: int) -> Any:
    try:
        context = importlib.import_module(f"mujoco.{backend}").GLContext(width, height)
        context.make_current()
    except Exception as error:  # each layer below raises exceptions of its own
        raise NoGLError(f"{backend}: {type(error).__name__}: {error}") from error
    return context
