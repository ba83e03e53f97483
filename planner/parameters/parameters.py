"""Parameters of a fold, and the presets.

``default`` is ours, ``paper`` is as published, ``direct`` is the baseline that servoes straight to
the target without a record.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from typing import Any, Final, Literal

from planner.errors import InputError
from planner.parameters.explosion import ExplosionParameters, PeelingParameters, TableParameters
from planner.parameters.playback import PlaybackParameters
from planner.parameters.published import PUBLISHED_PLAYBACK, PaperExplosionParameters

World = Literal["floating", "table"]
PRESETS: Final = ("default", "paper", "direct")
"""Names of sets of parameters: foldback's own method (``default``), the published method
(``paper``), and servos that turn straight to the shape's angles (``direct``)."""
BASELINE: Final = "one-by-one"
STRATEGIES: Final = ("simultaneous", "blocks", "peel", BASELINE)
AUTO: Final = "auto"
STRATEGY_OPTIONS: Final = (AUTO, *STRATEGIES)
FLOATING: Final = "floating"
WORLDS: Final = (FLOATING, "table")
"""Names of environments in which a chain folds: floating without gravity, or on a table under
gravity."""


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
        strategy: One of ``STRATEGY_OPTIONS``, see ``planner.explosion.strategies``.
        module_size: Size at which the plan is verified, as a fraction of the pitch.
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
    module_size: float = 0.95
    density_kg_m3: float = 2700.0
    joint_speed_limit_rad_s: float = 1.0

    def as_dict(self) -> dict[str, Any]:
        """Return plain JSON values, nested as the parameters are."""
        return asdict(self)


def unknown_strategy(name: str) -> InputError:
    """Return the error for a strategy that does not exist."""
    return InputError(
        "unknown-strategy",
        f"got the strategy {name!r}, expected one of: {', '.join(STRATEGY_OPTIONS)}.",
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
