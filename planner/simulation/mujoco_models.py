"""MuJoCo models of a chain, built through MjSpec: the single tree and the segments.

Lengths are in pitches and a module has mass 1. Bodies and geoms are named ``module_<i>``, hinges as
in ``Chain.joint_names``. In both models every hinge coordinate of MuJoCo is the hinge angle.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any, Final

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.module import Module
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.simulation.lazy_mujoco import mujoco

SEGMENT_MODULES: Final = 8
"""Number of modules of a segment: in MuJoCo's model, a long chain consists of short trees
(segments) that are welded end to end. With 5 to 12 a simulation step costs about the same, with 32
ten times as much. Measured."""
MIN_LIMITED_MEMORY_MODULES: Final = 1000
"""Number of modules above which the memory of a MuJoCo model of separate bodies or segments is set
explicitly, as MuJoCo's default grows with the square of the number."""
MODULE_MEMORY_BYTES: Final = 2**19
"""Memory for each module, bytes, in MuJoCo models of long chains, for which MuJoCo's default would
be too large."""

SOLIMP: Final = [0.95, 0.99, 0.005, 0.5, 2.0]
"""MuJoCo's ``solimp`` (dmin, dmax, width, midpoint, power) of contacts: their impedance rises from
0.95 at first touch to 0.99 at a depth of 0.005 pitches."""
STIFF_SOLREF_SOLIMP: Final = ([0.02, 1.0], [0.9999, 0.9999, 0.001, 0.5, 2.0])
"""MuJoCo's ``solref`` (time constant in s, damping ratio) and ``solimp`` of constraints that are to
be nearly rigid: hinge stops, welds, motors and brakes. Impedances below 0.9999 let them yield
more."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """Properties of the joints and surfaces of a simulated chain (pitch 1, module mass 1).

    Attributes:
        geom_size: Size of the collision hull as a fraction of the full module.
        stiffness: Stiffness of the hinges' springs towards straight, torque per rad.
        armature: Rotor inertia of every hinge, module mass · pitch².
        damping: Hinge damping, torque per rad/s; must be 0 in segments, whose welds it breaks.
        friction: Coefficient of sliding friction of contacts; 0 for none.
        contact_time_constant: Time constant of contacts, ``solref[0]``, s.
        stops_early_rad: Angle before the ends of the hinges' ranges at which stops begin, rad.
        stiff_stops: True if the stops hardly give, as the welds between segments.
    """

    geom_size: float = 0.99
    stiffness: float = 0.0
    armature: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    contact_time_constant: float = 0.03
    stops_early_rad: float = 0.0
    stiff_stops: bool = False


def base_spec() -> Any:
    """Return an empty spec with the options of all models: no gravity, no automatic reset."""
    spec = mujoco.MjSpec()
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    # Modules 0 and 1 of a cube chain are one rigid body, and the filter would drop the contacts of
    # their neighbours. Consecutive modules are exempted one by one instead.
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_FILTERPARENT)
    spec.compiler.autolimits = True
    spec.compiler.degree = False
    return spec


def compiled(spec: Any) -> Any:
    """Return the model of a spec; MuJoCo then logs no warnings to the working directory.

    Callers that step a model check the warnings in its data instead.
    """
    mujoco.set_mju_user_warning(_ignore)
    return spec.compile()


def _ignore(warning: str) -> None:
    del warning


def add_part_meshes(spec: Any, module: Module, module_size: float) -> None:
    """Add the parts of a module that are no boxes as meshes, at the given size."""
    for number, part in enumerate(part for piece in module.pieces for part in piece.parts):
        if part.box is None:
            mesh = spec.add_mesh()
            mesh.name = mesh_name(module, number)
            mesh.uservert = (part.corners * module_size).ravel().tolist()


def mesh_name(module: Module, part: int) -> str:
    """Return the name of the mesh of a module's part: ``module`` if it is the only one."""
    return "module" if len(module.hull.parts) == 1 else f"part_{part}"


def add_module_geoms(body: Any, module: Module, index: int, material: Material) -> list[Any]:
    """Add the parts of module ``index`` to a body, without mass, and return their geoms."""
    piece = module.pattern[index % len(module.pattern)]
    first = int(module.hull.pieces[piece, 0])
    geoms: list[Any] = []
    for k, part in enumerate(module.pieces[piece].parts):
        options: dict[str, Any] = {
            "name": f"module_{index}_{k}" if k else f"module_{index}",
            "mass": 0.0,
            "condim": 3 if material.friction > 0 else 1,
            "friction": [max(material.friction, 1e-5), 0.0, 0.0],
            "solref": [material.contact_time_constant, 1.0],
            "solimp": SOLIMP,
            "margin": 0.0,
        }
        if part.box is None:
            mesh = mesh_name(module, first + k)
            options |= {"type": mujoco.mjtGeom.mjGEOM_MESH, "meshname": mesh}
        else:
            centre, half = (material.geom_size * place for place in part.box)
            options |= {
                "type": mujoco.mjtGeom.mjGEOM_BOX,
                "pos": centre.tolist(),
                "size": half.tolist(),
            }
        geoms.append(body.add_geom(**options))
    return geoms


def set_inertia(body: Any, chain: Chain, index: int, mass: float) -> None:
    """Set the inertia of a body to that of module ``index`` with a given mass."""
    module = chain.module
    body.explicitinertial = True
    body.mass = mass
    body.ipos = [0.0, 0.0, 0.0]
    body.inertia = (module.moments[module.joint.row(index)] * mass).tolist()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Link:
    """Pose of a body in the frame of its neighbour, and hinges in its own, as in MuJoCo."""

    position: list[float]
    wxyz: list[float]
    hinge_position: list[float]
    axes: list[list[float]]


@cache
def _to_next(module: Module, row: int) -> _Link:
    joint = module.joint
    turn, offset = joint.turn[row], joint.offset[row]
    return _Link(
        position=(joint.anchor[row] + turn @ offset).tolist(),
        wxyz=wxyz_from_matrix(turn).tolist(),
        hinge_position=(-offset).tolist(),
        axes=(joint.axes[row] @ turn).tolist(),
    )


@cache
def _to_previous(module: Module, row: int) -> _Link:
    joint = module.joint
    turn, anchor = joint.turn[row], joint.anchor[row]
    return _Link(
        position=(-joint.offset[row] - turn.T @ anchor).tolist(),
        wxyz=wxyz_from_matrix(turn.T).tolist(),
        hinge_position=anchor.tolist(),
        axes=(-joint.axes[row][::-1]).tolist(),
    )


def add_next_body(parent: Any, chain: Chain, index: int, name: str, material: Material) -> Any:
    """Add the body of module ``index`` to that of module ``index − 1``, with its hinges."""
    link = _to_next(chain.module, chain.module.joint.row(index - 1))
    body = _add_linked(parent, name, link)
    for hinge, axis in zip(_hinges(chain, index - 1, material), link.axes, strict=False):
        _add_hinge(body, hinge, link, axis, material)
    return body


def add_previous_body(parent: Any, chain: Chain, index: int, name: str, material: Material) -> Any:
    """Add the body of module ``index`` to that of module ``index + 1``, with its hinges."""
    link = _to_previous(chain.module, chain.module.joint.row(index))
    body = _add_linked(parent, name, link)
    for hinge, axis in zip(_hinges(chain, index, material)[::-1], link.axes, strict=False):
        _add_hinge(body, hinge, link, axis, material)
    return body


def _add_linked(parent: Any, name: str, link: _Link) -> Any:
    body = parent.add_body()
    body.name = name
    body.pos = link.position
    body.quat = link.wxyz
    return body


def _hinges(chain: Chain, index: int, material: Material) -> list[tuple[str, list[float]]]:
    """Return names and stops of the hinges between modules ``index`` and ``index + 1``."""
    names, joint = hinge_names(chain, index), chain.module.joint_after(index)
    stops = chain.stops_rad(material.stops_early_rad, slice(joint, joint + 1)) if names else []
    return [(name, [low, high]) for name, (low, high) in zip(names, stops, strict=True)]


def _add_hinge(
    body: Any,
    named_stops: tuple[str, list[float]],
    link: _Link,
    axis: list[float],
    material: Material,
) -> None:
    hinge = body.add_joint()
    hinge.name, stops = named_stops
    hinge.type = mujoco.mjtJoint.mjJNT_HINGE
    hinge.pos = link.hinge_position
    hinge.axis = axis
    hinge.range = stops
    if material.stiff_stops:
        hinge.solref_limit, hinge.solimp_limit = STIFF_SOLREF_SOLIMP
    hinge.stiffness[0] = material.stiffness
    hinge.armature = material.armature
    hinge.damping[0] = material.damping


def hinge_names(chain: Chain, index: int) -> tuple[str, ...]:
    """Return the names of the hinges between modules ``index`` and ``index + 1``."""
    module = chain.module
    if module.joint_after(index) < 0:
        return ()
    return tuple(f"joint_{index}_{h}" if h else f"joint_{index}" for h in module.hinge_names)


def exclude(spec: Any, names: list[str], pairs: Iterable[tuple[int, int]]) -> None:
    """Exempt pairs of modules from contact."""
    for first, second in pairs:
        spec.add_exclude(bodyname1=names[first], bodyname2=names[second])


def tree_spec(
    chain: Chain,
    material: Material,
    *,
    exempt: Iterable[tuple[int, int]] | None = None,
    masses: Array | None = None,
) -> Any:
    """Return the spec of a single tree, rooted at the chain's root module with a free joint.

    Recorded angles are exact by construction. The mass matrix is dense along the chain, so a step's
    cost grows with the cube of its length: for some hundreds of modules.

    Args:
        chain: The chain.
        material: Material of the modules.
        exempt: Pairs of modules that don't collide; all consecutive ones by default.
        masses: (n,) masses of the modules; those of their pieces by default.
    """
    masses = chain.module.masses(len(chain)) if masses is None else masses
    spec = base_spec()
    spec.modelname = "foldback"
    module = chain.module
    n = len(chain)
    add_part_meshes(spec, module, material.geom_size)
    names = [f"module_{i}" for i in range(n)]
    root = spec.worldbody.add_body()
    root.name = names[chain.root]
    root.add_freejoint().name = "root"
    bodies: dict[int, Any] = {chain.root: root}
    for i in range(chain.root + 1, n):
        bodies[i] = add_next_body(bodies[i - 1], chain, i, names[i], material)
    for i in range(chain.root - 1, -1, -1):
        bodies[i] = add_previous_body(bodies[i + 1], chain, i, names[i], material)
    for i, body in bodies.items():
        set_inertia(body, chain, i, float(masses[i]))
        add_module_geoms(body, module, i, material)
        site = body.add_site()
        site.name = names[i]
        site.size = [0.02, 0.02, 0.02]
        site.group = 4
    exclude(spec, names, pairwise(range(n)) if exempt is None else exempt)
    return spec


def segment_starts(
    chain: Chain, modules: int = SEGMENT_MODULES, *, root: int | None = None
) -> list[int]:
    """Return the first modules of the segments; the root, the chain's by default, is one."""
    root = chain.root if root is None else root
    starts = list(range(root % modules, len(chain), modules))
    shortest = chain.module.rigid_links + 2
    if not starts or starts[0] != 0:
        starts = [0, *starts]
    if len(starts) > 1 and starts[1] < shortest and starts[1] != root:
        del starts[1]
    return starts


def segment_spec(chain: Chain, material: Material, starts: list[int]) -> Any:
    """Return the spec of a chain that is cut into free trees, which are welded end to end.

    The last body of a segment, ``ghost_<i>``, is a half-mass copy without geometry of the next
    segment's first module, which has the other half. Every hinge is in one segment only, so all
    hinge angles and one root's pose are the full state.

    Args:
        chain: The chain.
        material: Material of its joints and surfaces.
        starts: First modules of the segments.
    """
    spec = base_spec()
    module = chain.module
    n = len(chain)
    masses = module.masses(n).tolist()
    if n > MIN_LIMITED_MEMORY_MODULES:
        spec.memory = MODULE_MEMORY_BYTES * n
    add_part_meshes(spec, module, material.geom_size)
    names = [f"module_{i}" for i in range(n)]
    for k, start in enumerate(starts):
        stop = starts[k + 1] if k + 1 < len(starts) else n
        root = spec.worldbody.add_body()
        root.name = names[start]
        body = root
        set_inertia(root, chain, start, masses[start] * (1.0 if k == 0 else 0.5))
        root.add_freejoint().name = f"root_{start}"
        add_module_geoms(root, module, start, material)
        for i in range(start + 1, stop):
            body = add_next_body(body, chain, i, names[i], material)
            set_inertia(body, chain, i, masses[i])
            add_module_geoms(body, module, i, material)
        if stop < n:
            ghost = add_next_body(body, chain, stop, f"ghost_{stop}", material)
            set_inertia(ghost, chain, stop, 0.5 * masses[stop])
            weld = spec.add_equality()
            weld.type = mujoco.mjtEq.mjEQ_WELD
            weld.objtype = mujoco.mjtObj.mjOBJ_BODY
            weld.name1 = f"ghost_{stop}"
            weld.name2 = names[stop]
            weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]
            weld.solref, weld.solimp = STIFF_SOLREF_SOLIMP
    exclude(spec, names, pairwise(range(n)))
    return spec
