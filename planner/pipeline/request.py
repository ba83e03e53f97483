"""Request: the one description of what can be requested of a fold, and its only check.

The page, the API, the command line, the client and the docs take options, limits, texts and
refusals from here. A new option is one more field.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Final

from foldback.planner.chain.module import DEFAULT_MODULE_SIZE, TWIST_MODULE_SIZE, Module
from foldback.planner.errors import InputError
from foldback.planner.parameters.joint_error import MAX_CHARS as MAX_JOINT_ERROR_CHARS
from foldback.planner.parameters.joint_error import RANGE_DEG, read_joint_error
from foldback.planner.parameters.option import key_of_options, option
from foldback.planner.parameters.parameters import (
    AUTO,
    BASELINE,
    MAX_AUTO_TURNING_MODULES,
    PRESET_CHOICES,
    STRATEGY_CHOICES,
    TURNS,
    Parameters,
    preset,
)
from foldback.planner.parameters.settings_text import (
    MAX_TEXT_CHARS,
    ROBOT_SETTINGS,
    SETTINGS,
    names_with_units,
    read_settings,
    settings_text,
    with_settings,
)
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.planner.pipeline.preference import COMPUTING, PREFERENCES, Preference

if TYPE_CHECKING:
    from foldback.planner.plan.plan import Plan

MAX_SEED: Final = 2**32 - 1
"""Maximum random seed of a request, the largest unsigned integer of 32 bits; a larger one is
refused."""
PATH_SEED_MODULUS: Final = 2**31
"""Number of different seeds of a path search; a request's seed is reduced modulo it, so that it
fits into a signed integer of 32 bits."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PreviewRequest(PathOptions):
    """Everything that can be requested of a preview, apart from its input.

    Attributes:
        seed: Random seed of the path search.
        path: True to search for a path; a fold always does.
        quick: True for a first result, where a search has one.
    """

    seed: int = 0
    path: bool = True
    quick: bool = False

    @property
    def complete(self) -> PreviewRequest:
        """Request for the final result, otherwise the same."""
        return replace(self, quick=False)

    @classmethod
    def of_fold(cls, request: FoldRequest) -> PreviewRequest:
        """Return the preview that finds the same path as a fold."""
        return cls(**asdict(request.path_options()), seed=request.seed)

    @property
    def key(self) -> str:
        """Return a key that is the same for the same options."""
        return key_of_options(self)

    def check(self) -> None:
        """Refuse what no fold can have either.

        Raises:
            InputError: Naming the parameter in ``where``.
        """
        FoldRequest(**asdict(self.path_options()), seed=self.seed).check()


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldRequest(PathOptions):
    """Everything that can be requested of a fold, apart from its input.

    Fields with an ``Option`` are what a person can choose; the others follow from the input.

    Attributes:
        filename: Name of the input, if any.
        refold: True if the chain starts folded as in the base plan, not straight.
        smooth: True to smooth the base plan in place of an explosion.
    """

    preset: str = option(
        "default",
        title="Preset",
        help="Folding method. `default` is foldback's own method, and `paper` is the published "
        "method. For comparison, `direct` turns all joints directly to their final angles (direct "
        "servoing); it fails for most shapes.",
        label="Method",
        choices=PRESET_CHOICES,
    )
    settings: str = option(
        "",
        title="Settings",
        help="Settings to change, for example `damping=0.05,radial_gain=0.2`. Settings of the "
        f"presets `paper` and `direct`: {names_with_units(SETTINGS)}. Settings of the robots that "
        f"the preset `default` simulates: {names_with_units(ROBOT_SETTINGS)}. The command "
        "`foldback settings` explains all settings.",
        max_chars=MAX_TEXT_CHARS,
    )
    seed: int = option(
        0,
        title="Random seed",
        help="Another number leads to another motion.",
        label="Random start",
        range=(0, MAX_SEED),
    )
    module_size: float | None = option(
        None,
        title="Module size in the clearance check, as a fraction of the pitch",
        noun="module size",
        help="Edge length of a module in the clearance check, in pitches. One pitch is the "
        "distance between the centres of two neighbouring modules. Default: "
        f"{DEFAULT_MODULE_SIZE}; for chains of twist joints, {TWIST_MODULE_SIZE}; when a plan is "
        "smoothed, the module size of that plan.",
        range=(0.1, 1.0),
        unit="times the pitch",
    )
    joint_error: str | None = option(
        None,
        title="Error of each hinge for which the largest possible module size is found",
        help="Error of the hinges of a real robot, for example `0.3deg` for good servos or "
        f"`0.005rad`; from {RANGE_DEG[0]:g} to {RANGE_DEG[1]:g} degrees. foldback then finds the "
        "largest module size at which at least 95 of 100 robots fold without a collision, if each "
        "hinge is off by a random angle of up to this error. `joint_errors` in the certificate "
        "states this size, and the error that the plan tolerates at its own size. With the "
        "preference `margin`, several plans are compared by this size.",
        metavar="ANGLE",
        max_chars=MAX_JOINT_ERROR_CHARS,
    )
    strategy: str = option(
        AUTO,
        title="Strategy",
        help="How the folded chain is pulled apart: all modules at once (`simultaneous`), rigid "
        "blocks first (`blocks`), or one part at a time from one end (`peel`). `turns` folds "
        "without an explosion: in steps of quarter turns that a person can follow, with a rest "
        "after each; `one-by-one` turns one hinge in each step. `auto` folds chains of up to "
        f"{MAX_AUTO_TURNING_MODULES} cubes in turns if these keep as much clearance as an "
        "explosion. Otherwise it chooses among the explosions by size and path; for long chains it "
        "uses `peel`.",
        choices=STRATEGY_CHOICES,
    )
    at_once: int | None = option(
        None,
        title="Largest number of hinges that turn at once, for the strategy turns",
        noun="number of hinges at once",
        help="Maximum number of hinges that turn in one step of the strategy `turns`, for example "
        "for a weak power supply, or for two hands. Default: no limit.",
        range=(1, 1000),  # the longest chain that folds in turns has fewer
        unit="hinges",
    )
    prefer: Preference = option(
        COMPUTING,
        title="Preferred plan",
        noun="preference",
        help="Preferred plan. To save computing time, `computing` takes the first verified plan. "
        "With the other values, foldback compares several verified plans and takes the best. "
        "`time` means the shortest folding time at the joints' speed limit, `torque` the smallest "
        "torque for the same folding time, `clearance` the largest proved clearance, `margin` "
        "the largest error that any one hinge may have without a collision, and `calm` the least "
        "motion of the hinges with the fewest at once. "
        "The comparison tries other strategies, paths and smoothings. It takes about ten times as "
        "long, but at most about 300 s longer. `attempts` in the plan lists all "
        "compared plans with their figures.",
        label="Look for",
        choices={**PREFERENCES},
    )
    filename: str | None = None
    refold: bool = False
    smooth: bool = False

    @classmethod
    def smoothing(cls, plan: Plan, *, seed: int, module_size: float | None) -> FoldRequest:
        """Return the request to smooth a plan, at its own module size when that is None."""
        size = plan.certificate.module_size if module_size is None else module_size
        return cls(filename=f"{plan.chain.name}.json", seed=seed, module_size=size, smooth=True)

    def check(self) -> None:
        """Refuse an invalid request, with the same message for every interface.

        Raises:
            InputError: Naming the parameter in ``where``.
        """
        try:
            self.parameters()
            plain = FoldRequest()
            if self.prefer != plain.prefer and self._one_plan:
                raise InputError(
                    "unsuited-prefer",
                    f"got the preference {self.prefer!r}, expected {plain.prefer!r}, because the "
                    f"{self._one_plan} gives only one plan; use the default preset and strategy to "
                    "choose among several plans.",
                )
            if self.at_once is not None and self.strategy != TURNS:
                raise InputError(
                    "unsuited-at-once",
                    f"got a number of hinges at once for the strategy {self.strategy!r}, expected "
                    f"the strategy {TURNS!r}; select it, or leave the number out.",
                )
            if self.world == "table":
                self._check_table()
            for name in ("preset", "strategy") if self.smooth else ():
                if getattr(self, name) != getattr(plain, name):
                    raise InputError(
                        f"smooth-{name}",
                        f"got the {name} {getattr(self, name)!r}, expected none, because smoothing "
                        f"a plan runs no new explosion; leave out the option '{name}'.",
                    )
        except InputError as error:
            raise _placed(error) from None

    def _check_table(self) -> None:
        """Refuse options that are not possible on a table.

        Raises:
            InputError: ``unsuited-world``.
        """
        plain = FoldRequest()
        for name, noun in (
            ("preset", "preset"),
            ("module", "module"),
            ("strategy", "strategy"),
            ("prefer", "preference"),
            ("ends", "choice of ends"),
        ):
            if (value := getattr(self, name)) != getattr(plain, name):
                raise InputError(
                    "unsuited-world",
                    f"got the {noun} {value!r} for a fold on a table, expected "
                    f"{getattr(plain, name)!r}; use the 'floating' world for other values.",
                )
        if self.method not in ("auto", "blocks"):
            raise InputError(
                "unsuited-world",
                f"got the path method {self.method!r} for a fold on a table, expected 'auto' or "
                "'blocks'; use the 'floating' world for other methods.",
            )
        if self.start is not None:
            raise InputError(
                "unsuited-world",
                "got a start cell for a fold on a table, expected no start cell, because the path "
                "is chosen for stability; leave the start cell out, or use the 'floating' world.",
            )
        if self.refold or self.smooth:
            raise InputError(
                "unsuited-world",
                "got a refold or smoothing for a fold on a table, expected a new fold of a shape; "
                "use the 'floating' world to refold or smooth.",
            )

    @property
    def _one_plan(self) -> str | None:
        """Option that leaves only one plan to choose from; None if there may be several."""
        if self.smooth:
            return "smoothing of a plan"
        if self.preset != FoldRequest().preset:
            return f"preset {self.preset!r}"
        return f"strategy {self.strategy!r}" if self.strategy in (TURNS, BASELINE) else None

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
        return replace(preset(self.preset), world=self.world)

    def parameters(self, module: Module | None = None, *, smoothed: bool = False) -> Parameters:
        """Return the parameters of the request.

        Args:
            module: The kind of module that is folded, which has a default size, and may have the
                mass and speed of a real robot; None for any.
            smoothed: True for the parameters of smoothing a plan.

        Raises:
            InputError: An unknown preset, or a seed or module size out of range.
        """
        PathOptions.check(self)
        parameters = self._plain()
        if module is not None:
            parameters = parameters.of_robot(module)
        if self.settings:
            parameters = with_settings(parameters, read_settings(self.settings))
        parameters = replace(parameters, strategy=self.strategy, at_once=self.at_once)
        if self.prefer == "time":
            parameters = replace(
                parameters, playback=replace(parameters.playback, paced_by="speed")
            )
        if self.smooth or smoothed:
            # Frames are joined by straight lines: a finer curve would go round their corners.
            parameters = replace(
                parameters, playback=replace(parameters.playback, spacing_rad=0.06)
            )
        size = self.module_size
        if size is None:
            size = parameters.module_size if module is None else module.default_size
        error_rad = None if self.joint_error is None else read_joint_error(self.joint_error)
        return replace(parameters, module_size=size, joint_error_rad=error_rad)


def _placed(error: InputError) -> InputError:
    """Return the refusal with the parameter that it is about: codes end in its name."""
    field = error.code.partition("-")[2].replace("-", "_")
    return error.changed(where=field)
