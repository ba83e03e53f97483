"""Moving drawings: SVG files in which a chain folds as recorded.

They need no script, so that lists can show them in place of a drawing. An ``<img>`` plays them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.chain import Chain
from foldback.web.pictures.isometric import DRAWING_MARGIN_PITCH, PITCH_UNITS, Drawing
from foldback.web.pictures.isometric_modules import chain_drawing, projected

Array = NDArray[np.float64]

DRAWING_SIZE_PX: Final = 160
"""Width and height of moving drawings, in CSS pixels; they scale."""
MAX_POINTS: Final = 6000
"""Maximum number of points in a moving drawing of a motion, each of a module in a frame; together
they take about 35 kB."""
MAX_FRAMES: Final = 28
"""Maximum number of frames of a motion between which a moving drawing interpolates."""
MIN_FRAMES: Final = 8
"""Number of frames below which the motion would not be recognised; longer chains are not drawn."""
SAMPLED_FRAMES: Final = 120
"""Number of recorded frames among which those of a moving drawing are chosen."""
FOLDING_S: Final = 6.0
"""Duration of a drawing in which a chain folds, in s."""


def frames_of_motion(recorded: int, modules: int) -> int:
    """Return the number of frames of a moving drawing; 0 if the chain is too long for one."""
    frames = min(MAX_FRAMES, recorded, MAX_POINTS // modules)
    return frames if frames >= min(MIN_FRAMES, recorded) else 0


def folding_svg(chain: Chain, positions: Sequence[Array]) -> str:
    """Draw a recorded motion that ends in the folded shape.

    Args:
        chain: The chain.
        positions: (n, 3) centres of the modules in two or more consecutive frames, pitches.
    """
    drawing = chain_drawing(chain)
    pictures = [projected(chain.module, frame) for frame in _standing(chain, positions)]
    pictures = _evenly(pictures, frames_of_motion(len(pictures), len(chain)))
    folded = projected(chain.module, chain.folded_poses.positions)
    pictures = [picture + folded.mean(axis=0) for picture in pictures]
    left, top, width, height = map(float, drawing.box.split())
    margin = DRAWING_MARGIN_PITCH * PITCH_UNITS
    boxes = [_square(p.min(axis=0) - margin, p.max(axis=0) + margin) for p in pictures[:-1]]
    boxes.append(_square(np.array([left, top]), np.array([left + width, top + height])))
    times = ";".join(f"{0.72 * k / (len(pictures) - 1):.3g}" for k in range(len(pictures))) + ";1"
    motion = ";".join(_line(picture) for picture in (*pictures, pictures[-1]))
    wide = _spacing(folded)
    lines = "".join(
        f'<use href="#c" stroke="{colour}" stroke-width="{share * wide:.1f}"/>'
        for colour, share in (("#646d79", 1.0), ("#d5dae0", 0.75))
    )
    chain_lines = (
        f'<defs><path id="c" fill="none">{_animated("d", motion, times)}</path></defs>{lines}'
    )
    body = (
        _animated("viewBox", ";".join((*boxes, boxes[-1])), times)
        + _shown(chain_lines, "1;1;0;0", "0;.72;.78;1")
        + _shown(drawing.body, "0;0;1;1;0", "0;.7;.76;.96;1")
    )
    return Drawing(body, boxes[0]).svg(size=DRAWING_SIZE_PX)


def _standing(chain: Chain, positions: Sequence[Array]) -> list[Array]:
    """Return frames around their middle, turned so that the last one is as in the drawing.

    A floating chain turns as a whole while it folds. The straight chain is not turned, and the
    others more and more, as in the player (``Standing`` in ``kinematics.js``).
    """
    from scipy.spatial.transform import Rotation  # late: importing it takes a while

    centred = [frame - frame.mean(axis=0) for frame in positions]
    folded = chain.folded_poses.positions
    turn = Rotation.align_vectors(folded - folded.mean(axis=0), centred[-1])[0]
    shares = np.linspace(0.0, 1.0, len(centred))
    shares = shares * shares * (3 - 2 * shares)
    return [
        frame @ Rotation.from_rotvec(share * turn.as_rotvec()).as_matrix().T
        for frame, share in zip(centred, shares, strict=True)
    ]


def _evenly(pictures: Sequence[Array], count: int) -> list[Array]:
    """Return pictures between which about equally much changes, the first and last among them."""
    changes = [
        float(np.sqrt(np.mean((b - a) ** 2)) / np.ptp(b, axis=0).max())
        for a, b in zip(pictures, pictures[1:], strict=False)
    ]
    way = np.concatenate([[0.0], np.cumsum(changes)])
    at = np.interp(np.linspace(0.0, way[-1], count), way, np.arange(len(pictures)))
    return [pictures[k] for k in np.unique(np.rint(at).astype(int))]


def _spacing(points: Array) -> float:
    """Return the usual distance in a drawing between consecutive modules, in user units."""
    return float(np.median(np.linalg.norm(np.diff(points, axis=0), axis=1)))


def _square(low: Array, high: Array) -> str:
    """Return the smallest square around a rectangle, as a ``viewBox``."""
    side = float((high - low).max())
    left, top = (low + high - side) / 2
    return f"{left:.0f} {top:.0f} {side:.0f} {side:.0f}"


def _line(points: Array) -> str:
    """Return the data of a path through points; short steps need few characters."""
    rounded = np.rint(points).astype(int)
    x, y = rounded[0].tolist()
    steps = "".join(f" {dx} {dy}" for dx, dy in np.diff(rounded, axis=0).tolist())
    return f"M{x} {y}l{steps.replace(' -', '-').strip()}"


def _animated(name: str, values: str, times: str) -> str:
    return (
        f'<animate attributeName="{name}" values="{values}" keyTimes="{times}" '
        f'dur="{FOLDING_S:g}s" repeatCount="indefinite"/>'
    )


def _shown(body: str, opacities: str, times: str) -> str:
    """Return a group whose opacity changes over time."""
    return f"<g>{_animated('opacity', opacities, times)}{body}</g>"
