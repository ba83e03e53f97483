"""Circuits through all nodes of a directed graph, by a SAT solver.

Each arc has a variable, and each node one arc in and one arc out. A solution may consist of
several circuits: then each of them gets the clauses that one arc enters it and one leaves it, and
the solver is asked again, as Dantzig, Fulkerson and Johnson (1954) cut off partial tours.
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from itertools import combinations
from typing import Any, Final, Literal

import numpy as np

Arc = tuple[int, int]
Status = Literal["found", "infeasible", "undecided"]

CONFLICTS_PER_EFFORT: Final = 80_000
"""Number of conflicts (dead ends in its search) of the SAT solver that make up one unit of effort,
by which path searches are limited instead of by time, so that they are reproducible: about one
second of processor time. Measured."""


class CircuitSolver:
    """A search for a circuit through all nodes; constraints may be added between two solutions."""

    def __init__(
        self,
        nodes: int,
        arcs: Sequence[Arc],
        *,
        seed: int,
        effort: float,
        time_limit_s: float = float("inf"),
    ) -> None:
        """Set up the clauses.

        Args:
            nodes: Number of nodes.
            arcs: (from, to) pairs of nodes, each of them once.
            seed: Chooses among solutions.
            effort: Deterministic effort of all calls of ``solve`` together, about seconds.
            time_limit_s: Wall-clock limit from now on, s.
        """
        from pysat.solvers import Cadical195  # heavy, and needed here only

        self._conflicts_left = effort * CONFLICTS_PER_EFFORT
        self._deadline = time.monotonic() + time_limit_s
        # The solver branches in the order of the variables: their numbers are shuffled.
        numbers = np.random.default_rng(seed).permutation(len(arcs)) + 1
        self._variables: dict[Arc, int] = dict(zip(arcs, numbers.tolist(), strict=True))
        self._arcs = {variable: arc for arc, variable in self._variables.items()}
        self._top = len(arcs)
        self._counter: Any = None
        self._solver: Any = Cadical195()
        self._solver.configure({"phase": 0})  # most arcs are unused
        self._leaving: list[list[Arc]] = [[] for _ in range(nodes)]
        self._entering: list[list[Arc]] = [[] for _ in range(nodes)]
        for arc in arcs:
            self._leaving[arc[0]].append(arc)
            self._entering[arc[1]].append(arc)
        for group in (*self._leaving, *self._entering):
            self._require_one(group)
            for pair in combinations(group, 2):
                self.forbid(pair)
        if nodes > 2:
            for a, b in arcs:
                if a < b and (b, a) in self._variables:
                    self.forbid([(a, b), (b, a)])

    def forbid(self, arcs: Iterable[Arc]) -> None:
        """Exclude solutions that have all of these arcs."""
        self._solver.add_clause([-self._variables[arc] for arc in arcs])

    def allow_at_most(self, count: int, arcs: Iterable[Arc]) -> None:
        """Exclude solutions that have more than so many of the arcs.

        A further call must have the same arcs, and no larger count.
        """
        from pysat.card import ITotalizer

        if self._counter is None:
            variables = [self._variables[arc] for arc in arcs]
            self._counter = ITotalizer(variables, ubound=count, top_id=self._top)
            for clause in self._counter.cnf.clauses:
                self._solver.add_clause(clause)
        if count < len(self._counter.rhs):
            self._solver.add_clause([-self._counter.rhs[count]])

    def solve(self) -> tuple[Status, list[int]]:
        """Look for a solution.

        Returns:
            ``infeasible`` if it is proved that there is none, ``undecided`` if the effort or the
            time is spent; the nodes of the circuit in its order, from node 0 on.
        """
        while self._conflicts_left >= 1 and time.monotonic() < self._deadline:
            solved = self._call()
            if solved is None:
                continue
            if not solved:
                return "infeasible", []
            circuits = self._circuits()
            if len(circuits) == 1:
                return "found", circuits[0]
            for circuit in circuits:
                self._connect(circuit)
        return "undecided", []

    def _call(self) -> bool | None:
        """Run the solver for a bounded number of conflicts."""
        before = self._solver.accum_stats()["conflicts"]
        # between calls, time limits and Ctrl-C are checked
        self._solver.conf_budget(int(min(self._conflicts_left, 2000)))
        solved = self._solver.solve_limited()
        spent = self._solver.accum_stats()["conflicts"] - before
        self._conflicts_left -= spent + 20  # the work around a call counts, too
        return solved

    def _circuits(self) -> list[list[int]]:
        """Return the circuits of the solver's solution; the first begins with node 0."""
        used = (self._arcs[v] for v in self._solver.get_model()[: len(self._arcs)] if v > 0)
        following = dict(used)
        circuits: list[list[int]] = []
        for start in range(len(self._leaving)):
            if start in following:
                circuit = [start]
                while (node := following.pop(circuit[-1])) != start:
                    circuit.append(node)
                circuits.append(circuit)
        return circuits

    def _connect(self, circuit: list[int]) -> None:
        """Require arcs between these nodes and all others, in both directions."""
        inside = set(circuit)
        self._require_one(a for n in circuit for a in self._leaving[n] if a[1] not in inside)
        self._require_one(a for n in circuit for a in self._entering[n] if a[0] not in inside)

    def _require_one(self, arcs: Iterable[Arc]) -> None:
        self._solver.add_clause([self._variables[arc] for arc in arcs])
