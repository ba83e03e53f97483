"""Processes of their own for computations of benchmarks that need no limits and no stored rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Final, TypeVar

Argument = TypeVar("Argument")
Result = TypeVar("Result")
PROCESSES: Final = 2
"""Number of computations at the same time."""


def each_of(
    compute: Callable[[Argument], Result],
    arguments: Iterable[Argument],
    processes: int = PROCESSES,
) -> Iterator[Result]:
    """Compute a function of arguments in fresh processes; yield the results in their order."""
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield from pool.map(compute, arguments)
