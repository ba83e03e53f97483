"""Forces on a table: hinge torques and normal forces of the modules in every frame of a motion.

They belong to the equilibrium that a table certificate found (``table.npz`` of a fold).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from foldback.planner.errors import UNREADABLE, InputError

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TableForces:
    """Forces in a table certificate. NaN in frames without an equilibrium.

    Attributes:
        torques: (F, J) torque of every hinge, w·p.
        pressed: (F, n) normal force of the table on every module, module weights.
        torque: (F,) largest torque, w·p.
    """

    torques: Floats
    pressed: Floats
    torque: Floats

    def __len__(self) -> int:
        return len(self.torque)

    def save(self, path: FilePath) -> None:
        """Write an ``.npz``."""
        with path.open("wb") as file:
            np.savez_compressed(file, **{f.name: getattr(self, f.name) for f in fields(self)})

    @classmethod
    def load(cls, path: FilePath) -> TableForces:
        """Read a file that ``save`` wrote.

        Raises:
            InputError: ``no-forces`` if there is none, or it is damaged.
        """
        try:
            with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                columns = {f.name: np.asarray(file[f.name], dtype=np.float32) for f in fields(cls)}
        except UNREADABLE as error:
            raise InputError(
                "no-forces",
                f"{path.name} cannot be read ({type(error).__name__}); expected the table "
                "forces of a fold on a table.",
            ) from error
        shapes = [columns[name].shape for name in ("torques", "pressed", "torque")]
        if [len(shape) for shape in shapes] != [2, 2, 1] or len({s[0] for s in shapes}) != 1:
            raise InputError(
                "no-forces",
                f"got arrays of the shapes {shapes}, expected (F, J), (F, n) and (F,) for F "
                "frames, J hinges and n modules.",
            )
        return cls(**columns)
