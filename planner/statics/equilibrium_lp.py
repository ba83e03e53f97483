"""The linear program of an equilibrium, and its warm-started solver.

Forces f ≥ 0 along R rays give torques g + A f and leave the whole chain e + E f out of balance. The
scaled unknowns φ = f / t and s = 1 / t leave one ranged row a hinge, −1 ≤ s g + A φ ≤ 1, and
s e + E φ = 0; s is maximised. Nothing at all (φ = 0, s = 0) is always allowed, so that the primal
simplex method begins there, or where the last frame ended if that was alike.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import highspy
import numpy as np
from numpy.typing import NDArray

from foldback.planner.arrays import Array, Ints
from foldback.planner.errors import PlannerError

Columns = tuple[NDArray[np.int32], NDArray[np.int32], Array]
"""A sparse matrix by columns: where each starts, rows and values."""
PRIMAL, DUAL = 4, 1
"""HiGHS' numbers of the two simplex methods."""
BASIC: Final = highspy.HighsBasisStatus.kBasic
LOWER: Final = highspy.HighsBasisStatus.kLower
OPTIMAL: Final = highspy.HighsModelStatus.kOptimal


class Program:
    """Solver of a sequence of programs, each warm-started from the last one."""

    def __init__(self) -> None:
        self._highs = highspy.Highs()
        self._highs.silent()
        # Of these small programs presolve takes longer than it saves, and scaling as well.
        self._highs.setOptionValue("presolve", "off")
        self._highs.setOptionValue("solver", "simplex")
        self._highs.setOptionValue("simplex_strategy", PRIMAL)
        self._highs.setOptionValue("simplex_scale_strategy", 0)
        self._basis = _Basis(basic=np.empty(0, np.int64), last=False, rows=[])

    def pushes(
        self, keys: Ints, matrix: Columns, weight: Array, hinges: int, max_scale: float
    ) -> Array:
        """Return the (R,) force of each ray; all zeros without equilibrium.

        Args:
            keys: (R,) identify rays from frame to frame.
            matrix: Load of a unit force of each ray on every row.
            weight: (rows,) load of the weights.
            hinges: Number of leading rows that are hinges.
            max_scale: Largest s: the reciprocal of the smallest torque of interest.

        Raises:
            PlannerError: The solver gives up.
        """
        self._pass(matrix, weight, hinges, max_scale)
        if start_basis := self._basis.of(keys, len(weight)):
            self._highs.setBasis(start_basis)
        self._highs.run()
        if self._highs.getModelStatus() != OPTIMAL:
            self._once_more()
        scaled = np.array(self._highs.getSolution().col_value)
        self._basis = _Basis.from_solution(self._highs.getBasis(), keys)
        if scaled[-1] <= 1e-9:  # else rounding
            return np.zeros(len(keys))
        return np.maximum(scaled[:-1], 0.0) / scaled[-1]

    def _once_more(self) -> None:
        """Solve again from scratch by the dual simplex method with scaling."""
        self._highs.clearSolver()
        self._highs.setOptionValue("simplex_strategy", DUAL)
        self._highs.setOptionValue("simplex_scale_strategy", 2)
        self._highs.run()
        self._highs.setOptionValue("simplex_strategy", PRIMAL)
        self._highs.setOptionValue("simplex_scale_strategy", 0)
        if (status := self._highs.getModelStatus()) != OPTIMAL:
            raise PlannerError(
                f"the solver of the contact forces ended with the status "
                f"{self._highs.modelStatusToString(status)!r}, expected an optimum; please report "
                "this error together with the plan."
            )

    def _pass(self, matrix: Columns, weight: Array, hinges: int, max_scale: float) -> None:
        starts, rows, values = matrix
        columns = len(starts)  # one more than rays: the last one is s
        heavy = np.flatnonzero(weight)
        cost, upper = np.zeros(columns), np.full(columns, highspy.kHighsInf)
        cost[-1], upper[-1] = -1.0, max_scale
        limits = np.zeros(len(weight))
        limits[:hinges] = 1.0
        passed = self._highs.passModel(
            columns,
            len(weight),
            len(rows) + len(heavy),
            int(highspy.MatrixFormat.kColwise),
            int(highspy.ObjSense.kMinimize),
            0.0,
            cost,
            np.zeros(columns),
            upper,
            -limits,
            limits,
            starts,
            np.append(rows, heavy).astype(np.int32),
            np.append(values, weight[heavy]),
            np.zeros(columns, dtype=np.int32),  # none of them is a whole number
        )
        if passed == highspy.HighsStatus.kError:
            raise PlannerError(
                "got poses with infinite, undefined or very large numbers, which the solver of the "
                "contact forces rejects; expected finite numbers"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Basis:
    """Basis at the end of the simplex method.

    Attributes:
        basic: Keys of the rays in the basis.
        last: True if s is in it.
        rows: State of every row.
    """

    basic: Ints
    last: bool
    rows: list[highspy.HighsBasisStatus]

    @classmethod
    def from_solution(cls, basis: highspy.HighsBasis, keys: Ints) -> _Basis:
        status = basis.col_status
        basic = np.fromiter((state == BASIC for state in status), bool, len(status))
        return cls(basic=keys[basic[:-1]], last=bool(basic[-1]), rows=basis.row_status)

    def of(self, keys: Ints, rows: int) -> highspy.HighsBasis | None:
        """Return a start basis for other rays; None if too few of its rays are among them."""
        if len(self.rows) != rows:
            return None
        basic = np.isin(keys, self.basic)
        common_count = int(basic.sum())
        if common_count < 0.8 * len(self.basic):
            return None
        basis = highspy.HighsBasis()
        basis.valid = True
        basis.alien = common_count < len(self.basic)  # gaps are to be filled
        basis.col_status = [
            BASIC if is_basic else LOWER for is_basic in [*basic.tolist(), self.last]
        ]
        basis.row_status = self.rows
        return basis
