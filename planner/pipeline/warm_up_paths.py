"""Warm-up of compiled code: nothing is left to do."""

from foldback.planner.pipeline.warm_up import (
    warm_up_chains as warm_up_chains,
)
from foldback.planner.pipeline.warm_up import (
    warm_up_fit as warm_up_fit,
)
from foldback.planner.pipeline.warm_up import (
    warm_up_paths as warm_up_paths,
)
