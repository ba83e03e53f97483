"""Sweeps: many folds on this machine or a cluster, as one table.

A ``spec`` states what is folded. ``cases`` makes its folds of ``shapes``, and ``sweep`` hands out
those that have no row yet. ``run`` computes any cases on any executor, and ``executors`` has one
for Dask. There, ``limited_process`` computes each case (a ``fold_task``) in a process that
``case_forker`` forks. ``rows`` stores the results, and ``map`` draws them. A ``planner_digest`` in
each row names the planner that has computed it.
"""

from typing import Final

PACKAGES: Final = ("distributed", "pyarrow", "psutil", "tomli_w", "cryptography")
"""Packages of the extra ``sweep`` without which there are no sweeps."""
