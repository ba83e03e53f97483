"""MuJoCo as an untyped module, loaded with the first name that is used of it.

Its compiled part comes without type stubs, and who only reads a plan simulates nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any


class _Late:
    """A module whose names are looked up once each."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, name: str) -> Any:
        found = getattr(import_module(self._name), name)
        setattr(self, name, found)
        return found


mujoco: Any = _Late("mujoco")
