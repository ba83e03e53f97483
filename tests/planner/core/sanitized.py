"""Plugin of pytest: tests use the core in the folder that FOLDBACK_CORE names.

``make sanitize`` passes it a build that checks addresses, indices and undefined behaviour.
"""

import os
import sys
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

NAME = "foldback.planner.core._core"

(built,) = Path(os.environ["FOLDBACK_CORE"]).glob("_core*.so")
spec = spec_from_file_location(NAME, built, loader=ExtensionFileLoader(NAME, str(built)))
assert spec is not None and spec.loader is not None
sys.modules[NAME] = module_from_spec(spec)
spec.loader.exec_module(sys.modules[NAME])
