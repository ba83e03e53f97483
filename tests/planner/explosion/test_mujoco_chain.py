"""Explosions and playbacks that MuJoCo computes alone, with the setting ``engine=mujoco``."""

from dataclasses import replace
from typing import Any, NoReturn

import numpy as np
import pytest

from foldback.planner.certificate.certificate import certify
from foldback.planner.chain.built_in_modules import TETRAHEDRON
from foldback.planner.chain.chain import Chain
from foldback.planner.clearance.sweep import sweep
from foldback.planner.errors import InputError
from foldback.planner.explosion.simultaneous import explode
from foldback.planner.explosion.strategies import ranked_strategies
from foldback.planner.parameters.explosion import ExplosionParameters
from foldback.planner.parameters.parameters import Parameters, preset
from foldback.planner.parameters.settings_text import read_settings, with_settings
from foldback.planner.playback.playback import play_back
from foldback.planner.simulation.engine import Engine
from foldback.planner.simulation.mujoco_chain import MAX_MUJOCO_MODULES, MujocoChain
from foldback.planner.simulation.mujoco_models import Material
from foldback.planner.simulation.segments import Segments
from tests.planner.chains import coil, line, random_state
from tests.planner.explosion import chain_reference
from tests.planner.folds import intercept

MATERIAL = Material(geom_size=0.5, stiffness=3.0, armature=10.0)
BY_MUJOCO = with_settings(preset("default"), {"engine": "mujoco"})


@pytest.mark.parametrize(
    "chain",
    [line(20), coil(16), Chain.from_angles(TETRAHEDRON, np.zeros(11))],
    ids=["line", "coil", "tetrahedra"],
)
def test_mujocos_step_without_contacts_is_that_of_our_engine(chain: Chain) -> None:
    state = random_state(chain, 3)
    forces = np.random.default_rng(4).normal(size=(len(chain), 3))
    ours, mujocos = Segments(chain, MATERIAL), MujocoChain(chain, MATERIAL)
    for engine in (ours, mujocos):
        engine.place(state)
        engine.set_stiffness(np.linspace(1.0, 3.0, len(chain.folded_rad)))
        engine.set_rotor_inertias(np.linspace(5.0, 15.0, len(chain.folded_rad)))
    expected = chain_reference.accelerations(ours, state, forces)
    mujocos.set_step(0.05)
    acceleration = mujocos.accelerations(state, forces)
    assert acceleration.contacts == expected.contacts == 0
    moved, expected_state = state.copy(), state.copy()
    for which, of in ((moved, acceleration), (expected_state, expected)):
        which.accelerate(of, 0.05, 0.5)
        which.scale_velocities(0.7)
    mujocos.advance(moved, 0.05)
    expected_state.advance(0.05)
    for name in ("angles", "rates", "position", "rotation", "velocity", "spin"):
        np.testing.assert_allclose(
            getattr(moved, name), getattr(expected_state, name), atol=1e-9, err_msg=name
        )


def test_fold_by_mujoco_alone_is_verified_and_repeatable(
    hook_chain: Chain, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: Any, **__: Any) -> NoReturn:
        raise AssertionError("our engine was used")

    monkeypatch.setattr(Engine, "constrained", refuse)
    options: Any = BY_MUJOCO.explosion
    chain = hook_chain
    record = explode(chain, options, seed=0)
    assert record.status == "straight" and record.steps > 10
    playback = play_back(chain, record, BY_MUJOCO.playback)
    assert (playback.status, playback.robots, playback.mujoco_rad) == ("folded", 3, None)
    assert 1e-6 < playback.max_angle_error_rad < 1e-3
    assert certify(chain, record, playback, BY_MUJOCO, with_margins=False).verified
    again = explode(chain, options, seed=0)
    np.testing.assert_array_equal(again.frames.angles_rad, record.frames.angles_rad)


def test_mujocos_contacts_keep_modules_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    chain, options = coil(24), BY_MUJOCO.explosion
    contacts = list[int]()

    def watched(_: int, original: Any, *arguments: Any) -> Any:
        acceleration = original(*arguments)
        contacts.append(acceleration.contacts)
        return acceleration

    intercept(monkeypatch, MujocoChain, "accelerations", watched)
    assert isinstance(options, ExplosionParameters)
    record = explode(chain, options, seed=0)
    assert record.status == "straight" and max(contacts) > 0
    assert sweep(chain, record.frames, module_size=options.verify_size).clearance > 0.0


def test_line_which_needs_no_torque_folds_in_mujoco() -> None:
    chain, options = line(5), BY_MUJOCO.explosion
    assert isinstance(options, ExplosionParameters)
    playback = play_back(chain, explode(chain, options, seed=0), BY_MUJOCO.playback)
    assert (playback.status, playback.peak_torque) == ("folded", 0.0)


def test_what_mujoco_does_not_simulate_is_refused_with_a_remedy() -> None:
    short, long = coil(8), line(MAX_MUJOCO_MODULES + 1)
    assert "peel" not in ranked_strategies(short, BY_MUJOCO)
    for chain, parameters, code in (
        (long, BY_MUJOCO, "too-long-for-mujoco"),
        (short, replace(BY_MUJOCO, world="table"), "mujoco-on-table"),
        (short, replace(BY_MUJOCO, strategy="peel"), "strategy-differs"),
        (short, replace(BY_MUJOCO, strategy="blocks"), "strategy-differs"),
    ):
        with pytest.raises(InputError, match="engine=mujoco") as refusal:
            ranked_strategies(chain, parameters)
        assert refusal.value.code == code
    paper: Parameters = preset("paper")
    with pytest.raises(InputError, match="does not use it"):
        with_settings(paper, read_settings("engine=mujoco"))
