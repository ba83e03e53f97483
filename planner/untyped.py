"""MuJoCo as an untyped module: its compiled part comes without type stubs."""

from __future__ import annotations

from typing import Any

import mujoco as _mujoco

mujoco: Any = _mujoco
