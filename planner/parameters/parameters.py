"""Parameters of a fold, and the presets.

``default`` is ours, ``paper`` is as published, ``direct`` is the baseline that servoes straight to
the target without a record.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, is_dataclass, replace
from typing import TYPE_CHECKING, Any, Final, Literal, cast

from foldback.planner.chain.module import DEFAULT_DENSITY_KG_M3, DEFAULT_MODULE_SIZE, Module
from foldback.planner.errors import InputError
from foldback.planner.parameters.explosion import (
    ExplosionParameters,
    PeelingParameters,
    TableParameters,
)
from foldback.planner.parameters.option import Choice, Choices
from foldback.planner.parameters.playback import PUBLISHED_PLAYBACK, PlaybackParameters
from foldback.planner.parameters.published import PaperExplosionParameters

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

World = Literal["floating", "table"]
PRESET_CHOICES: Final[Choices] = {
    "default": Choice(label="foldback’s own"),
    "paper": Choice(label="As in the paper", note="the published method"),
    "direct": Choice(
        label="Joints turned directly (usually fails)",
        note="turns all joints directly to their final angles; fails for most shapes",
    ),
}
"""Sets of parameters by name, with their texts for people."""
PRESETS: Final = tuple(PRESET_CHOICES)
"""Names of sets of parameters: foldback's own method (``default``), the published method
(``paper``), and servos that turn straight to the shape's angles (``direct``)."""
TURNS: Final = "turns"
BASELINE: Final = "one-by-one"
TURN_STRATEGIES: Final = (TURNS, BASELINE)
"""Strategies that search for turns, without forces."""
AUTO: Final = "auto"
STRATEGY_CHOICES: Final[Choices] = {
    AUTO: Choice(label="Automatic"),
    "simultaneous": Choice(label="All at once"),
    "blocks": Choice(label="Blocks first"),
    "peel": Choice(label="One part at a time, from one end"),
    TURNS: Choice(label="Quarter turns, with rests between"),
    BASELINE: Choice(label="One hinge at a time"),
}
"""Explosion strategies, see ``planner.explosion.strategies``; ``auto`` chooses one of the others by
size and path."""
MAX_AUTO_TURNING_MODULES: Final = 64
"""Maximum number of modules of a chain of cubes for which ``auto`` looks for turns before it
explodes the chain: docs/decisions/0028-turns.md."""
FLOATING: Final = "floating"
WORLD_CHOICES: Final[Choices] = {
    FLOATING: Choice(
        label="In zero gravity",
        note="no gravity",
        hint="There is no gravity. This choice is the fastest and accepts any shape.",
    ),
    "table": Choice(
        label="On a table",
        note="on a table, with gravity",
        hint="The table supports the chain at all times, so the motors need little torque.",
    ),
}
"""Environments in which a chain folds: floating without gravity, or on a table under gravity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameters:
    """All numbers that a fold depends on, apart from its chain and seed.

    Attributes:
        preset: Name of the set.
        explosion: Parameters of the explosion; None for direct servoing.
        playback: Parameters of the playback.
        peeling: Parameters of the explosion when the chain is peeled.
        table: Parameters of the explosion on a table.
        world: ``floating``, or on a ``table`` under gravity.
        strategy: One of ``STRATEGY_CHOICES``, see ``planner.explosion.strategies``.
        at_once: Maximum number of hinges that turn in one step of turns; None for no limit.
        module_size: Size at which the plan is verified, as a fraction of the pitch.
        joint_error_rad: Error of each hinge for which a module size is looked for; None for none.
        density_kg_m3: Density of a solid module, for torques in newton-metres.
        joint_speed_limit_rad_s: Largest speed of a hinge; sets the fold time in the certificate.
    """

    preset: str = "default"
    explosion: ExplosionParameters | PaperExplosionParameters | None = field(
        default_factory=ExplosionParameters
    )
    playback: PlaybackParameters = field(default_factory=PlaybackParameters)
    peeling: PeelingParameters = field(default_factory=PeelingParameters)
    table: TableParameters = field(default_factory=TableParameters)
    world: World = "floating"
    strategy: str = "auto"
    at_once: int | None = None
    module_size: float = DEFAULT_MODULE_SIZE
    joint_error_rad: float | None = None
    density_kg_m3: float = DEFAULT_DENSITY_KG_M3
    joint_speed_limit_rad_s: float = 1.0

    def of_robot(self, module: Module) -> Parameters:
        """Return the parameters with density and joint speed of a module's real robot, if known."""
        values: dict[str, float] = {}
        if module.mass_kg is not None and module.pitch_m is not None:
            values["density_kg_m3"] = module.mass_kg / (module.volume * module.pitch_m**3)
        if module.speed_rad_s is not None:
            values["joint_speed_limit_rad_s"] = module.speed_rad_s
        return replace(self, **values)

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values, nested as the parameters are, without what is None."""
        values = asdict(self)
        for name in ("at_once", "joint_error_rad"):
            if values[name] is None:
                del values[name]
        return values


def with_defaults(values: Mapping[str, Any], parameters: DataclassInstance) -> dict[str, Any]:
    """Return plain values of parameters in which those that are absent have their defaults.

    Args:
        values: Values as ``Parameters.as_dict`` gives them, perhaps without parameters that a later
            version added.
        parameters: Parameters of the same classes; only the defaults of their fields count.
    """
    complete = {**asdict(type(parameters)()), **values}
    for parameter in fields(parameters):
        part, value = getattr(parameters, parameter.name), complete[parameter.name]
        if isinstance(value, Mapping) and is_dataclass(part) and not isinstance(part, type):
            complete[parameter.name] = with_defaults(cast("Mapping[str, Any]", value), part)
    return complete


def unknown_strategy(name: str) -> InputError:
    """Return the error for a strategy that does not exist."""
    return InputError(
        "unknown-strategy",
        f"got the strategy {name!r}, expected one of: {', '.join(STRATEGY_CHOICES)}.",
    )


def preset(name: str) -> Parameters:
    """Return the parameters of a preset.

    Raises:
        InputError: ``unknown-preset``.
    """
    if name == "default":
        return Parameters()
    if name == "paper":
        return Parameters(
            preset="paper",
            explosion=PaperExplosionParameters(),
            playback=PUBLISHED_PLAYBACK,
        )
    if name == "direct":
        return Parameters(
            preset="direct",
            explosion=None,
            playback=replace(PUBLISHED_PLAYBACK, controller="direct", max_steps=20_000),
        )
    raise InputError(
        "unknown-preset", f"got the preset {name!r}, expected one of: {', '.join(PRESETS)}."
    )
