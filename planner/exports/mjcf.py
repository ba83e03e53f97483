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
    straight_root = (folded.positions.mean(axis=0), wxyz_from_matrix(folded.rotations[chain.root]))
    for name, angles, position, wxyz in (
        ("straight", np.zeros_like(chain.folded_rad), *straight_root),
        ("folded", chain.folded_rad, folded.positions[chain.root], straight_root[1]),
    ):
        qpos = np.zeros(model.nq)
        qpos[:3], qpos[3:7] = position, wxyz
        qpos[addresses] = angles
        spec.add_key(name=name, qpos=qpos.tolist())
    spec.compile()
    return str(spec.to_xml())
