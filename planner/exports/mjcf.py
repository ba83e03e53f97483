"""MJCF: the chain as one MuJoCo tree, with the folded and the straight configuration as keys."""

from __future__ import annotations

import numpy as np

from planner.chain import Chain
from planner.model import Material, tree_spec
from planner.rotations import wxyz_from_matrix


def mjcf(chain: Chain, *, module_size: float) -> str:
    """The chain as MJCF text that plain MuJoCo loads.

    Joints are named as in ``Chain.joint_names``, their values are the plan's angles. The free joint
    ``root`` is that of the root module. The site ``module_<i>`` sits at the centre of module i.
    Keys ``straight`` and ``folded`` exist. Lengths are in pitches.

    Args:
        chain: The chain.
        module_size: Size of the colliding hulls as a fraction of the pitch.
    """
    spec = tree_spec(chain, Material(geom_size=module_size))
    model = spec.compile()
    addresses = [int(model.joint(name).qposadr[0]) for name in chain.joint_names]
    folded = chain.folded_poses
    upright = wxyz_from_matrix(folded.rotations[chain.root])
    keys = ""
    for name, angles, position in (
        ("straight", np.zeros_like(chain.folded_rad), folded.positions.mean(axis=0)),
        ("folded", chain.folded_rad, folded.positions[chain.root]),
    ):
        qpos = np.zeros(model.nq)
        qpos[:3], qpos[3:7] = position, upright
        qpos[addresses] = angles
        # MuJoCo's own writer keeps six digits: over a long chain that is a visible error.
        keys += f'    <key name="{name}" qpos="{" ".join(map(repr, qpos.tolist()))}"/>\n'
    text = str(spec.to_xml()).rstrip()
    end = "</mujoco>"
    return f"{text.removesuffix(end)}  <keyframe>\n{keys}  </keyframe>\n{end}\n"
