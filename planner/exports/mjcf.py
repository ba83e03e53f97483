"""MJCF: the chain as one MuJoCo tree, with configurations of its fold as keys."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from foldback.planner.arrays import Array
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.rotations import wxyz_from_matrix
from foldback.planner.exports.mjcf_pieces import coordinates, pieces
from foldback.planner.plan.plan import Plan
from foldback.planner.simulation.mujoco_models import Material, tree_spec

MAX_MODEL_MODULES: Final = 100_000
"""Maximum number of modules of a fold whose files include a model, which then has 130 MB. Larger
ones are written when somebody asks for them."""
MAX_TREE_MODULES: Final = 800
"""Maximum number of modules that an MJCF model nests in one kinematic tree. A longer chain is split
into pieces joined by welds (``planner.exports.mjcf_pieces``), as deep nesting exceeds MuJoCo's
parser."""
KEY_PERCENTS: Final = (0, 25, 50, 75, 100)
"""Moments of the plan, in percent of its duration, that an MJCF model offers as keyframes named
``at_0`` to ``at_100``."""
_NUMBERED_BODY: Final = re.compile(r'(<body name|\bbody[12])="((?:module|ghost)_\d+)"')

_PLACED: Final = re.compile(r'<(?P<kind>body|joint) name="(?P<name>[^"]+)"[^>]*>')
_POSE: Final = re.compile(r' (pos|quat|axis)="([^"]*)"')


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Key:
    """A configuration by name.

    Attributes:
        name: Name of the key.
        angles_rad: (J,) hinge angles.
        position: (3,) centre of the root module in pitches.
        wxyz: (4,) its orientation.
        time_s: Time of the configuration in the plan.
    """

    name: str
    angles_rad: Array
    position: Array
    wxyz: Array
    time_s: float = 0.0


def write(plan: Plan) -> bytes:
    """Return the plan's chain as MJCF, with keys on the way besides ``straight`` and ``folded``."""
    text = mjcf(plan.chain, module_size=plan.certificate.module_size, keys=keys_of(plan))
    return text.encode()


def keys_of(plan: Plan) -> tuple[Key, ...]:
    """Frames of the plan at ``KEY_PERCENTS`` of its time; none when it has no frames."""
    if not len(plan.time_s):
        return ()
    key_times = np.array(KEY_PERCENTS) / 100.0 * plan.time_s[-1]
    frames = np.abs(plan.time_s[:, None] - key_times).argmin(axis=0)
    motion = plan.motion[frames].dense(plan.chain)
    return tuple(
        Key(
            name=f"at_{percent}",
            angles_rad=motion.joint_angles_rad[k],
            position=motion.root_position[k],
            wxyz=motion.root_wxyz[k],
            time_s=float(motion.time_s[k]),
        )
        for k, percent in enumerate(KEY_PERCENTS)
    )


def mjcf(chain: Chain, *, module_size: float, keys: Sequence[Key] = ()) -> str:
    """Return the chain as MJCF text that plain MuJoCo loads.

    Joints are named as in ``Chain.joint_names``, their values are the plan's angles. The free joint
    ``root`` is that of the root module. The site ``module_<i>`` sits at the centre of module i.
    Keys ``straight`` and ``folded`` exist. Excluded from contact is ``Module.exempt_pairs``, as in
    the certificate. Lengths are in pitches. A chain of more than
    ``MAX_TREE_MODULES`` modules comes in pieces that are welded end to end. Bodies are named as by
    ``named_bodies``.

    Args:
        chain: The chain.
        module_size: Size of the colliding hulls as a fraction of the pitch.
        keys: Further configurations.
    """
    if len(chain) > MAX_TREE_MODULES:
        text = pieces(chain, module_size=module_size)
    else:
        exempt = chain.module.exempt_pairs(len(chain))
        spec = tree_spec(chain, Material(geom_size=module_size), exempt=exempt)
        text = _with_all_digits(str(spec.to_xml()).rstrip(), spec)
    lines = "".join(_key(chain, key) for key in (*_ends(chain), *keys))
    end = "</mujoco>"
    return f"{named_bodies(text).removesuffix(end)}  <keyframe>\n{lines}  </keyframe>\n{end}\n"


def _with_all_digits(text: str, spec: Any) -> str:
    """Return a model with all digits of the poses of bodies, and of centres and axes of joints.

    MuJoCo's own writer keeps six digits; where that loses nothing, they stay. MuJoCo normalises
    quaternions and axes when it reads them.
    """

    def element(match: re.Match[str]) -> str:
        kind, name = match["kind"], match["name"]
        values = getattr(spec, kind)(name)

        def attribute(found: re.Match[str]) -> str:
            exact = np.array(getattr(values, found[1]), dtype=np.float64)
            short = np.array(found[2].split(), dtype=np.float64)
            if found[1] != "pos":
                exact, short = exact / np.linalg.norm(exact), short / np.linalg.norm(short)
            if np.abs(exact - short).max() < 1e-15:
                return found[0]
            return f' {found[1]}="{" ".join(map(repr, exact.tolist()))}"'

        return _POSE.sub(attribute, match[0])

    return _PLACED.sub(element, text)


def named_bodies(text: str) -> str:
    """Return a model whose bodies are named ``module_<i>_body`` instead of ``module_<i>``.

    Drake makes a body for each but the last joint of a body and names it by appending a digit: from
    ``module_2`` it makes ``module_20``, which a longer chain has already. Models of earlier
    versions become the same as new ones.
    """
    return _NUMBERED_BODY.sub(r'\1="\2_body"', text)


def _ends(chain: Chain) -> tuple[Key, Key]:
    """Return the keys ``straight`` and ``folded``."""
    folded = chain.folded_poses
    upright = wxyz_from_matrix(folded.rotations[chain.root])
    straight = Key(
        name="straight",
        angles_rad=np.zeros_like(chain.folded_rad),
        position=folded.positions.mean(axis=0),
        wxyz=upright,
    )
    at_the_end = Key(
        name="folded",
        angles_rad=chain.folded_rad,
        position=folded.positions[chain.root],
        wxyz=upright,
    )
    return straight, at_the_end


def _key(chain: Chain, key: Key) -> str:
    if len(chain) > MAX_TREE_MODULES:
        qpos = coordinates(chain, key.angles_rad, key.position, key.wxyz)
    else:
        qpos = np.concatenate([key.position, key.wxyz, tree_order(chain, key.angles_rad)])
    time = f' time="{key.time_s!r}"' if key.time_s else ""
    # MuJoCo's own writer keeps six digits: over a long chain that is a visible error.
    values = " ".join(map(repr, qpos.tolist()))
    return f'    <key name="{key.name}"{time} qpos="{values}"/>\n'


def tree_order(chain: Chain, angles_rad: Array) -> Array:
    """(J,) angles in the order of a single tree: from the root up, then from the root down."""
    hinges = chain.module.hinges_per_joint
    joints = angles_rad.reshape(-1, hinges)
    middle = chain.module.joint_after(chain.root)
    return np.concatenate([joints[middle:].ravel(), joints[:middle][::-1, ::-1].ravel()])
