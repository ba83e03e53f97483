"""Statics: time to solve a frame's equilibrium, and torques of floating plans on the floor.

``python -m bench --only statics``.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bench.sections import Section
from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.chain.cantilever_statics import static_torque
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.kinematics import forward_kinematics
from foldback.planner.chain.path import Path
from foldback.planner.pathfinding.assembly import layered_snake
from foldback.planner.pipeline.fold import fold
from foldback.planner.readers import read
from foldback.planner.readers.gallery import Gallery
from foldback.planner.statics.balance import Balance

Array = NDArray[np.float64]
TIMED_FRAMES: Final = 30
"""Number of frames of each kind (packed, half unfolded) for which the time to compute the joint
torques under gravity on the floor is measured."""
NOISE_RAD: Final = 0.003
"""Standard deviation of the random joint errors of a folded chain in the last of the timed frames,
in rad; they grow from 0 with each frame."""
MAX_FRAME_MS: Final = {32: None, 64: 10.0, 160: 40.0}
"""Maximum mean time of a frame, ms, by number of modules; None if it is only reported."""
STRETCH_FRAME_MS: Final = {64: 2.0, 160: 8.0}
"""Stretch goals for the same, ms."""
SEEDS: Final = (0, 1, 2)
"""Seeds of the plans of each shape."""
SUFFICIENT_TORQUE_WP: Final = 8.0
"""Largest joint torque, in w·p (module weight × pitch), below which the second of two timed
computations may end before it has found the smallest possible torque, as the explosion on a table
does."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A shape, and the torques of one frictionless plan that a prototype measured, w·p.

    Attributes:
        name: Name of the shape.
        chain: Returns the chain.
        held: Torque with the root held.
        resting: Torque in the best stable pose of each frame.
    """

    name: str
    chain: Callable[[], Chain]
    held: float
    resting: float


def _box(*sides: int) -> Callable[[], Chain]:
    def made() -> Chain:
        x, y, z = sides
        cells = [tuple(map(int, cell)) for cell in layered_snake((x, y, z))]
        return Chain.from_path(Path.from_cells(cells, name="x".join(map(str, sides))))

    return made


def _example(name: str) -> Callable[[], Chain]:
    def made() -> Chain:
        example = Gallery().shape(name)
        assert example is not None
        path = read(example.data)
        assert isinstance(path, Path)
        return Chain.from_path(path)

    return made


SHAPES: Final = (
    Shape(name="3×3×3", chain=_box(3, 3, 3), held=91, resting=33),
    Shape(name="4×4×2", chain=_box(4, 4, 2), held=120, resting=45),
    Shape(name="mallet-64", chain=_example("mallet-64"), held=496, resting=172),
    Shape(name="4×4×4", chain=_example("box-4x4x4"), held=496, resting=335),
    Shape(name="wrench-80", chain=_example("wrench-80"), held=780, resting=312),
)
"""Shapes whose plans are evaluated, with the prototype's torques."""
TIMED_CHAINS: Final = {32: _box(4, 4, 2), 64: _box(4, 4, 4), 160: _box(8, 5, 4)}
"""Chains whose frames are timed, by number of modules."""


def statics(reference_seconds: float) -> Section:
    """Measure the time for a frame, and plans of five shapes."""
    section = Section(name="statics")
    _times(section, reference_seconds)
    _plans(section)
    return section


def packed(chain: Chain) -> Iterator[tuple[Array, Array, Array]]:
    """Yield positions, rotations, angles of a folded chain on the floor with growing errors."""
    return _core(chain, len(chain))


def half_exploded(chain: Chain) -> Iterator[tuple[Array, Array, Array]]:
    """Yield the same quantities of frames whose second half is straight, as a tail."""
    return _core(chain, len(chain) // 2)


def _core(chain: Chain, core: int) -> Iterator[tuple[Array, Array, Array]]:
    direction = np.random.default_rng(0).normal(size=len(chain.folded_rad))
    held_hinges = max(core - 2, 0) * chain.module.hinges_per_joint
    for share in np.linspace(0.0, 1.0, TIMED_FRAMES):
        angles = chain.folded_rad + NOISE_RAD * share * direction
        angles[held_hinges:] = 0.0
        poses = forward_kinematics(
            chain.module,
            angles,
            root_position=chain.folded_position,
            root_wxyz=chain.folded_wxyz,
        )
        low = poses.positions[:core, 2].min()
        yield poses.positions + [0.0, 0.0, 0.5 - low], poses.rotations, angles


def _times(section: Section, reference_seconds: float) -> None:
    for modules, chain_kind in TIMED_CHAINS.items():
        chain = chain_kind()
        worst = 0.0
        for kind, frames in (("packed", packed), ("half exploded", half_exploded)):
            for enough in (0.0, SUFFICIENT_TORQUE_WP):
                took = _milliseconds(chain, frames, enough)
                mean, max_s = float(np.mean(took)), float(np.max(took))
                worst = max(worst, mean)
                target = "the least torque" if enough == 0.0 else f"any up to {enough:g} w·p"
                section.rows.append(
                    {
                        "case": f"{modules} modules, {kind}, {target}",
                        "modules": modules,
                        "mean_ms": mean,
                        "most_ms": max_s,
                        "references": mean / 1000.0 / reference_seconds,
                    }
                )
                section.add(
                    f"{modules} modules, {kind}: {target}", f"{mean:.1f} ms, at most {max_s:.1f} ms"
                )
        bar = MAX_FRAME_MS[modules]
        if bar is not None:
            section.add(
                f"a frame of {modules} modules, mean of the slowest kind",
                f"{worst:.1f} ms, {worst / 1000.0 / reference_seconds:.2g} references",
                f"≤ {bar:g} ms (stretch {STRETCH_FRAME_MS[modules]:g})",
                worst <= bar,
            )


def _milliseconds(
    chain: Chain, frames: Callable[[Chain], Iterator[tuple[Array, Array, Array]]], enough: float
) -> list[float]:
    balance = Balance(chain)
    balance.solve(*next(frames(chain)))  # import all libraries first
    took: list[float] = []
    for positions, rotations, angles in frames(chain):
        start_s = time.perf_counter()
        balance.solve(positions, rotations, angles, enough=enough)
        took.append(1000.0 * (time.perf_counter() - start_s))
    return took


def _plans(section: Section) -> None:
    for shape in SHAPES:
        chain = shape.chain()
        rod_torque = static_torque(chain, np.zeros_like(chain.folded_rad))
        bounds: list[float] = []
        for seed in SEEDS:
            plan = fold(chain, seed=seed)
            certificate = table_certificate(plan.chain, plan.motion)
            section.rows.append(
                {
                    "case": shape.name,
                    "seed": seed,
                    "verdict": certificate.verdict,
                    "torque_wp": certificate.torque,
                    "frames": len(certificate.torques),
                    "seconds": certificate.seconds,
                }
            )
            if certificate.torque is not None:
                bounds.append(certificate.torque)
        section.add(
            f"{shape.name}: held at its root, straight",
            f"{rod_torque:.0f} w·p",
            f"{shape.held:g} within 10 %",
            abs(rod_torque / shape.held - 1.0) <= 0.1,
        )
        section.add(
            f"{shape.name}: best resting pose of each frame, without friction, {len(SEEDS)} seeds",
            f"{', '.join(f'{bound:.0f}' for bound in bounds)} w·p",
            f"a prototype's plan: {shape.resting:g}",
        )
