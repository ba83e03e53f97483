"""MuJoCo as an untyped module that is loaded when one of its names is first used.

Its compiled part has no type stubs, and processes that only read plans do not need it.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


class _LazyModule:
    """Module that is imported with the first of its names; each name is looked up once."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        value = getattr(import_module(self._name), name)
        setattr(self, name, value)
        return value


mujoco: Any = _LazyModule("mujoco")
