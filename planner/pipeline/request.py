"""Request: options of a fold, and their only check.

The page, the API and the command line refuse what cannot be asked for in these words.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from planner.chain.module import CUBE
from planner.errors import InputError
from planner.parameters.parameters import (
    AUTO,
    BASELINE,
    STRATEGY_OPTIONS,
    WORLDS,
    Parameters,
    World,
    preset,
    unknown_strategy,
)
from planner.parameters.settings import read_settings, settings_text, with_settings
from planner.pathfinding import Cell
from planner.pathfinding.options import MODULE_COUNTS, PathOptions
from planner.pathfinding.starts import cell_of
from planner.pipeline.preference import COMPUTING, Preference, preference_named

if TYPE_CHECKING:
    from planner.plan.plan import Plan

MODULE_SIZE_RANGE: Final = (0.1, 1.0)
"""Minimum and maximum module size that a request may ask for, as a fraction of the pitch (distance
between neighbouring modules). Smaller modules leave more clearance. Chosen."""
MAX_SEED: Final = 2**32 - 1
"""Maximum random seed of a request: the largest unsigned integer of 32 bits. Chosen."""
SMOOTH_SPACING_RAD: Final = 0.06
"""Distance of the control points of the curve that plays back a smoothed motion, in rad of joint
motion. Smaller values reproduce the corners between the motion's frames; larger ones cut corners
more. Chosen."""
PATH_SEED_MODULUS: Final = 2**31
"""Number of different seeds of a path search; a request's seed is reduced modulo it, so that it
fits into a signed integer of 32 bits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldRequest:
    """Options of a fold, apart from its shape.

    Attributes:
        filename: Name of the input, if any.
        preset: Name of a parameter set.
        seed: Random seed.
        module_size: Size at which the plan is verified; None for the preset's.
        settings: Other numbers for the preset ``paper`` or ``direct``, see
            ``planner.parameters.settings``.
        strategy: Explosion strategy: ``auto``, or one of ``planner.explosion.strategies``.
        prefer: Preference among several verified plans; ``computing`` takes the first one.
        refold: True if the chain starts folded as in the base plan, not straight.
        smooth: True to smooth the base plan in place of an explosion.
        world: ``floating``, or on a ``table`` under gravity.
        module, modules, method, repair, ends, as_voxels, start: See
            ``planner.pathfinding.options.PathOptions``.
    """

    filename: str | None = None
    preset: str = "default"
    seed: int = 0
    module_size: float | None = None
    settings: str = ""
    strategy: str = AUTO
    prefer: Preference = COMPUTING
    module: str = CUBE.name
    modules: int | None = None
    method: str = "auto"
    repair: bool = False
    ends: str = "any"
    as_voxels: bool = False
    start: Cell | None = None
    refold: bool = False
    smooth: bool = False
    world: World = "floating"

    @classmethod
    def smoothing(cls, plan: Plan, *, seed: int, module_size: float | None) -> FoldRequest:
        """Return the request to smooth a plan, at its own module size when that is None."""
        size = plan.certificate.module_size if module_size is None else module_size
        return cls(filename=f"{plan.chain.name}.json", seed=seed, module_size=size, smooth=True)

    @classmethod
    def of(cls, **given: Any) -> FoldRequest:
        """Return a request of typed values: numbers and the cell may still be texts.

        Raises:
            InputError: When one of them cannot be read.
        """
        read = dict(given)
        for name, number in (("seed", int), ("modules", int), ("module_size", float)):
            if isinstance(value := read.get(name), str):
                try:
                    read[name] = number(value)
                except ValueError:
                    raise _bad(name, repr(value[:40])) from None
        if isinstance(start := read.get("start"), str):
            try:
                read["start"] = cell_of(start)
            except InputError as error:
                raise _placed(error) from None
        return cls(**read)

    def check(self) -> None:
        """Refuse an invalid request, with the same message for every interface.

        Raises:
            InputError: Naming the parameter in ``where``.
        """
        try:
            self.parameters()
            self.path_options().check()
            plain = FoldRequest()
            preference_named(self.prefer)
            if self.prefer != plain.prefer and self._one_plan:
                raise InputError(
                    "unsuited-prefer",
                    f"got the preference {self.prefer} for the {self._one_plan}, which has only "
                    f"one plan, expected {plain.prefer}; use the default preset and strategy to "
                    "choose among plans.",
                )
            if self.world == "table":
                self._check_table()
            for name in ("preset", "strategy") if self.smooth else ():
                if getattr(self, name) != getattr(plain, name):
                    raise InputError(
                        f"smooth-{name}",
                        f"got the {name} {getattr(self, name)} for a plan to be smoothed, expected "
                        f"{getattr(plain, name)}; smoothing runs no new explosion.",
                    )
        except InputError as error:
            raise _placed(error) from None

    def _check_table(self) -> None:
        """Refuse options that are not possible on a table.

        Raises:
            InputError: ``unsuited-world``.
        """
        plain = FoldRequest()
        for name, what in (
            ("preset", "preset"),
            ("module", "module"),
            ("strategy", "strategy"),
            ("prefer", "preference"),
            ("ends", "choice of ends"),
        ):
            if (got := getattr(self, name)) != getattr(plain, name):
                raise InputError(
                    "unsuited-world",
                    f"got the {what} {got} for a fold on a table, expected "
                    f"{getattr(plain, name)}; use the world floating for other values.",
                )
        if self.method not in ("auto", "blocks"):
            raise InputError(
                "unsuited-world",
                f"got the path method {self.method} for a fold on a table, expected auto or "
                "blocks; use the world floating for other methods.",
            )
        if self.start is not None:
            raise InputError(
                "unsuited-world",
                "got a start cell for a fold on a table, expected none, because the path is chosen "
                "for stability; use the world floating to choose a start.",
            )
        if self.refold or self.smooth:
            raise InputError(
                "unsuited-world",
                "got a plan to be refolded or smoothed for a fold on a table, expected a shape; "
                "use the world floating for refolds and smoothing.",
            )

    @property
    def _one_plan(self) -> str | None:
        """Option that leaves only one plan to choose from; None if there may be several."""
        if self.smooth:
            return "smoothing of a plan"
        if self.preset != FoldRequest().preset:
            return f"preset {self.preset}"
        return f"strategy {self.strategy}" if self.strategy == BASELINE else None

    def canonical(self) -> FoldRequest:
        """Return the same request with its settings in the canonical form that is compared.

        Raises:
            InputError: ``bad-settings``, or ``unknown-preset``.
        """
        if not self.settings:
            return self
        return replace(self, settings=settings_text(self.settings, self._plain()))

    def _plain(self) -> Parameters:
        """Return the parameters of the preset in this world, without settings."""
        if self.world not in WORLDS:
            raise InputError(
                "unknown-world",
                f"got the world {self.world!r}, expected one of: {', '.join(WORLDS)}.",
            )
        return replace(preset(self.preset), world=self.world)

    def path_options(self) -> PathOptions:
        """Return the options that turn a shape into a path."""
        return PathOptions(
            module=self.module,
            modules=self.modules,
            method=self.method,
            repair=self.repair,
            ends=self.ends,
            as_voxels=self.as_voxels,
            start=self.start,
            world=self.world,
        )

    def parameters(self, *, smoothed: bool = False) -> Parameters:
        """Return the parameters of the request.

        Args:
            smoothed: True for the parameters of smoothing a plan.

        Raises:
            InputError: An unknown preset, or a seed or module size out of range.
        """
        found = self._plain()
        if self.settings:
            found = with_settings(found, read_settings(self.settings))
        if not 0 <= self.seed <= MAX_SEED:
            raise _bad("seed", str(self.seed))
        if self.strategy not in STRATEGY_OPTIONS:
            raise unknown_strategy(self.strategy)
        found = replace(found, strategy=self.strategy)
        if self.strategy == BASELINE:
            # One joint at a time, which no smooth curve does, is played back by kinematics alone.
            found = replace(found, playback=replace(found.playback, dynamic_up_to=1))
        if self.prefer == "time":
            found = replace(found, playback=replace(found.playback, paced_by="speed"))
        if self.smooth or smoothed:
            # Frames are joined by straight lines: a finer curve would go round their corners.
            found = replace(found, playback=replace(found.playback, spacing_rad=SMOOTH_SPACING_RAD))
        if self.module_size is None:
            return found
        low, high = MODULE_SIZE_RANGE
        if not low <= self.module_size <= high:
            raise _bad("module_size", f"{self.module_size:g}")
        return replace(found, module_size=self.module_size)


def _placed(error: InputError) -> InputError:
    """Return the refusal with the parameter that it is about: codes end in its name."""
    where = error.code.partition("-")[2].replace("-", "_")
    return InputError(error.code, error.detail, where=where)


def _bad(name: str, got: str) -> InputError:
    """Return the refusal of a number."""
    low, high = MODULE_SIZE_RANGE
    detail = {
        "seed": f"got the seed {got}, expected a whole number from 0 to {MAX_SEED}.",
        "modules": f"got {got} modules, expected {MODULE_COUNTS[0]} to {MODULE_COUNTS[1]}.",
        "module_size": f"got the module size {got}, expected {low:g} to {high:g} of the pitch.",
    }[name]
    return InputError(f"bad-{name.replace('_', '-')}", detail, where=name)
