import json

from planner.parameters.explosion import ExplosionParameters
from planner.parameters.parameters import PRESETS, Parameters, preset
from planner.parameters.published import PaperExplosionParameters


def test_presets() -> None:
    for name in PRESETS:
        values = json.loads(json.dumps(preset(name).as_dict(), allow_nan=False))
        assert (values["preset"], values["module_size"]) == (name, 0.95)
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
