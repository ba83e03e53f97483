"""Plan choice: the plans among which a preference chose, and its gain and cost."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypedDict, cast

from foldback.planner.certificate.figures import AttemptFigures
from foldback.planner.errors import DamagedError
from foldback.planner.pipeline.preference import (
    CALM,
    COMPUTING,
    PREFERENCES,
    PlanFigures,
    Preference,
)
from foldback.planner.smoothing import RECORDED, SMOOTHED, SOFTENED
from foldback.planner.storage.file_names import ATTEMPTS, CHAIN, PLANS_DIR
from foldback.planner.verification.integrity import check
from foldback.words.certificate import degrees_down, label_of, rounded_down
from foldback.words.quantities import STRATEGY_LABELS, number, quantity

TORQUE_COLUMNS: Final = ("Torque", "Torque at the same folding time")
"""Column headings of the largest torque, and of the largest torque if all plans took as long as the
slowest one."""
CALM_COLUMNS: Final = ("Travel / least", "Hinges at once")
"""Column headings, in place of ``TORQUE_COLUMNS``, where the calmest motion is preferred: travel of
all hinges divided by the least possible, and mean number of hinges that move at once."""
PREFERENCE_WORDS: Final[dict[Preference, str]] = {
    name: choice.label for name, choice in PREFERENCES.items()
}
"""Labels of the criteria by which one of several plans is chosen, by their names in the API."""
SUPERLATIVES: Final[dict[Preference, str]] = {
    "time": "fastest",
    "torque": "least torque",
    "clearance": "most clearance",
    "margin": "largest allowed hinge error",
    CALM: "calmest motion",
}
SMOOTHED_WORDS: Final = {
    SMOOTHED: "smoothed",
    SOFTENED: "slightly smoothed",
    RECORDED: "with new timing",
}
"""Labels of the ways in which a plan is made from the motion of another one."""


class PlanDot(TypedDict):
    """One plan: its name, its values in the plot, its cells under ``plan_columns``, and its result.

    ``torque_mnm`` is the torque if the plan took as long as the slowest one, in mN·m; ``room`` is
    the proved clearance, in pitches; ``moving`` is the mean number of hinges that move at once.
    Unknown values are None. ``stored`` is the number of the
    attempt, from 0, under which the plan can be played although it was not chosen.
    """

    label: str
    time_s: float | None
    torque_mnm: float | None
    room: float | None
    moving: float | None
    cells: list[str]
    verified: bool
    chosen: bool
    stored: int | None


class Choice(TypedDict):
    """All plans of a fold, and the gain and cost of its preference."""

    prefer: Preference
    wish: str
    seconds: float
    columns: list[str]
    plans: list[PlanDot]
    text: str


def choice_of(directory: Path, prefer: Preference, *, playable: bool = False) -> Choice | None:
    """Return the plans from which a preference chose; None without preference or verified plan.

    Args:
        directory: Directory of the fold.
        prefer: The requested preference.
        playable: True if stored plans that were not chosen can be played where this is shown.
    """
    if prefer == COMPUTING:
        return None
    try:
        check(directory, ATTEMPTS)
        values = json.loads((directory / ATTEMPTS).read_bytes())
    except (DamagedError, OSError, ValueError):
        return None
    attempts = cast("list[AttemptFigures]", values)
    plans = [
        _Plan(
            place=place,
            attempt=attempt,
            figures=PlanFigures(**figures),
            stored=_stored(directory, attempts, place) if playable else None,
        )
        for place, attempt in enumerate(attempts)
        if (figures := attempt.get("figures")) is not None
    ]
    verified = [plan for plan in plans if plan.verified]
    if not verified:
        return None
    slowest = max(plan.figures.fold_time_s or 0.0 for plan in verified)
    return {
        "prefer": prefer,
        "wish": PREFERENCE_WORDS[prefer],
        "seconds": slowest,
        "columns": list(plan_columns(prefer)),
        "plans": [plan.dot(slowest, prefer) for plan in plans],
        "text": _gained(prefer, attempts, verified, slowest),
    }


def plan_columns(prefer: Preference) -> tuple[str, ...]:
    """Return the column headings of the table that compares several plans of one fold."""
    compared = CALM_COLUMNS if prefer == CALM else TORQUE_COLUMNS
    time, clearance = label_of("fold_time_s"), label_of("clearance_bound")
    return ("Plan", f"{time}, s", *compared, f"{clearance}, pitch", f"{label_of('seconds')}, s")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plan:
    """An attempt with figures, and its index among all attempts."""

    place: int
    attempt: AttemptFigures
    figures: PlanFigures
    stored: int | None

    @property
    def verified(self) -> bool:
        return self.attempt.get("verified", False)

    @property
    def chosen(self) -> bool:
        return self.attempt.get("chosen", False)

    def dot(self, slowest: float, prefer: Preference) -> PlanDot:
        """Return the plan's values for the table and the plot, given the slowest plan's time."""
        figures = self.figures
        torque = figures.torque_in(slowest)
        torques = (_torque(figures.peak_torque_nm), _torque(torque))
        cells = (
            _told(figures.fold_time_s),
            *((_travel(figures), _moving(figures)) if prefer == CALM else torques),
            _room(figures.clearance_bound),
            number(figures.seconds, 2),
        )
        return {
            "label": f"{self.place + 1}. {self._label()}",
            "time_s": figures.fold_time_s,
            "torque_mnm": None if torque is None else 1e3 * torque,
            "room": figures.clearance_bound,
            "moving": figures.hinges_moving_mean,
            "cells": list(cells),
            "verified": self.verified,
            "chosen": self.chosen,
            "stored": self.stored,
        }

    def _label(self) -> str:
        """Return a short label of how the plan was made."""
        attempt, strategy = self.attempt, self.attempt["strategy"]
        if (smooths := attempt.get("smooths")) is not None:
            seed = f", seed {attempt['seed']}" if attempt["seed"] else ""
            manner = SMOOTHED_WORDS.get(strategy, strategy)
            return f"Plan {smooths + 1}, {manner}{seed}"
        parts = [STRATEGY_LABELS.get(strategy, strategy).partition(",")[0]]
        parts += [f"path {attempt['candidate'] + 1}"] if attempt["candidate"] else []
        parts += [f"seed {attempt['seed']}"] if attempt["seed"] else []
        parts += ["hinges turn more freely"] if attempt.get("plain") else []
        parts += ["smaller folding steps"] if "finer" in attempt else []
        parts += ["slower near straight"] if "patience" in attempt else []
        return ", ".join(parts)


def _stored(directory: Path, attempts: list[AttemptFigures], place: int) -> int | None:
    """Return the number under which an attempt's plan is stored beside the chosen one, or None."""
    # A repeated playback is stored with its explosion.
    while not attempts[place].keys().isdisjoint(("finer", "patience")):
        place -= 1
    return place if (directory / PLANS_DIR / str(place) / CHAIN).is_file() else None


def superlative(prefer: Preference, plans: int) -> str | None:
    """Return a short label of the chosen one of several plans; None without a choice."""
    return (
        f"{SUPERLATIVES[prefer]} of {plans} plans" if prefer in SUPERLATIVES and plans > 1 else None
    )


def _gained(
    prefer: Preference, attempts: list[AttemptFigures], verified: list[_Plan], slowest: float
) -> str:
    """Return the gain of the preference over the first verified plan, and its cost."""
    first = verified[0]
    best = next((plan for plan in verified if plan.chosen), first)
    since = attempts[first.place + 1 :]
    seconds = sum(
        attempt["figures"]["seconds"] if "figures" in attempt else attempt.get("seconds", 0.0)
        for attempt in since
    )
    cost = f"{number(seconds, 2)} s of additional computing"
    if best is first:
        return f"The first plan that worked is still the best after {cost}."
    figure_pair = (best.figures, first.figures)
    if prefer == "time":
        after, before = (_told(figures.fold_time_s) for figures in figure_pair)
        quantity, unit = label_of("fold_time_s").lower(), " s"
    elif prefer == "torque":
        after, before = (_torque(figures.torque_in(slowest)) for figures in figure_pair)
        quantity, unit = f"torque at the same folding time of {number(slowest)} s", ""
    elif prefer == "margin" and best.figures.size_with_errors is not None:
        after, before = (_filled(figures.size_with_errors) for figures in figure_pair)
        quantity, unit = "largest module size with the joint error", ""
    elif prefer == "margin":
        after, before = (_margin(figures.one_hinge_rad) for figures in figure_pair)
        quantity, unit = "allowed error in one hinge", ""
    elif prefer == CALM:
        return f"{_calmed(*figure_pair)}. Finding this plan took {cost}."
    else:
        after, before = (_room(figures.clearance_bound) for figures in figure_pair)
        before = f"{before} pitch"
        quantity, unit = label_of("clearance_bound").lower(), ""
    return (
        f"The {quantity} is {after}{unit} instead of {before}{unit}. Finding this plan took {cost}."
    )


def _calmed(after: PlanFigures, before: PlanFigures) -> str:
    """Return how much less the hinges move than in another plan."""
    text = f"The hinges travel {_travel(after)} instead of {_travel(before)} times the least"
    if _moving(after) == _moving(before):
        return text
    return f"{text}, and {_moving(after)} instead of {_moving(before)} of them move at once"


def _travel(figures: PlanFigures) -> str:
    return "–" if figures.travel_ratio is None else f"{figures.travel_ratio:.2f}"


def _moving(figures: PlanFigures) -> str:
    return "–" if figures.hinges_moving_mean is None else f"{figures.hinges_moving_mean:.0f}"


def _told(value: float | None) -> str:
    return "–" if value is None else number(value)


def _torque(value: float | None) -> str:
    return quantity(value, "N·m") or "–"


def _filled(size: float | None) -> str:
    return f"{rounded_down(100 * size, 1)} % of the spacing" if size else "none"


def _margin(value: float | None) -> str:
    return "–" if value is None else degrees_down(value)


def _room(value: float | None) -> str:
    return "–" if value is None else rounded_down(value, 4)
