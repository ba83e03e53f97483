from __future__ import annotations

import json
from dataclasses import FrozenInstanceError

import pytest

from planner.errors import InputError
from planner.parameters.explosion import ExplosionParameters
from planner.parameters.parameters import PRESETS, Parameters, preset
from planner.parameters.published import PaperExplosionParameters


@pytest.mark.parametrize("name", PRESETS)
def test_each_preset_knows_its_name_and_is_plain_json(name: str) -> None:
    parameters = preset(name)
    assert parameters.preset == name
    values = json.loads(json.dumps(parameters.as_dict(), allow_nan=False))
    assert values["preset"] == name
    assert values["module_size"] == 0.95


def test_what_the_presets_stand_for() -> None:
    assert preset("default") == Parameters()
    assert isinstance(preset("default").explosion, ExplosionParameters)
    assert preset("default").playback.controller == "robot"
    paper = preset("paper").explosion
    assert isinstance(paper, PaperExplosionParameters)
    published = (paper.radial_gain, paper.repulsion_gain, paper.step_s)
    assert published == (0.1, 1.0, 0.01)
    assert (paper.damping, paper.friction) == (0.1, 0.1)
    assert preset("paper").playback.threshold_rad2 == 0.15
    assert preset("paper").density_kg_m3 == 2700.0
    assert preset("direct").explosion is None
    assert preset("direct").playback.controller == "direct"


@pytest.mark.parametrize("name", ["", "Default", "fast", "../default"])
def test_an_unknown_preset_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, match="default, paper, direct") as refused:
        preset(name)
    assert refused.value.code == "unknown-preset"


def test_parameters_cannot_be_changed() -> None:
    with pytest.raises(FrozenInstanceError):
        preset("default").module_size = 0.5  # type: ignore[misc]
