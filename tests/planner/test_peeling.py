"""Chains come off their core straight, clear and the same each time; a buried one says so."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from planner.chain import Chain
from planner.errors import InputError
from planner.pathfinding.assembly import assembly_path
from planner.pathfinding.snake import snake_path
from planner.paths import Path
from planner.peeling import peel, turned_towards
from planner.peeling_parameters import PeelingParameters
from planner.peeling_record import PeelRecord
from planner.peeling_window import Bend, Peelable
from planner.progress import Progress
from planner.sweep import sweep
from planner.windows import Windows
from tests.planner.chains import line
from tests.planner.solids_made import tetrahedra_chain

DEFAULT = PeelingParameters()
