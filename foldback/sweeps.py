"""Sweeps: many folds as one table, on this machine or a cluster.

    from foldback.sweeps import Sweep

    methods = {"auto": {}, "paper": {"preset": "paper"}}
    sweep = Sweep(shapes=["gallery:*"], seeds=range(5), methods=methods)
    table = sweep.run("map")

It needs Dask and Arrow: ``pip install 'foldback[sweep]'``.
"""

from importlib.util import find_spec

from foldback.planner.sweeps import PACKAGES

if not all(map(find_spec, PACKAGES)):
    raise ImportError("foldback.sweeps needs Dask and Arrow: pip install 'foldback[sweep]'")

from foldback.planner.sweeps.case import Case, Limits, Outcome, Row
from foldback.planner.sweeps.sweep import Sweep

__all__ = ["Case", "Limits", "Outcome", "Row", "Sweep"]
