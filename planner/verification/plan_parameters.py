"""Plan parameters: those on which a certificate depends, and those of the request."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path as FilePath
from typing import Any, get_args

from foldback.planner.errors import UNREADABLE, InputError, PlannerError, named
from foldback.planner.parameters.explosion import Base
from foldback.planner.parameters.parameters import (
    FLOATING,
    WORLD_CHOICES,
    Parameters,
    preset,
    with_defaults,
)
from foldback.planner.pipeline.preference import COMPUTING
from foldback.planner.pipeline.workspace import Workspace
from foldback.planner.plan.plan import Plan, versions
from foldback.planner.plan.value_differences import Differences, value_differences, versus_plan
from foldback.planner.storage.file_names import PLAN, REQUEST


def playback_number(plan: Plan, name: str) -> float:
    """Return one of the plan's own parameters of playback.

    Raises:
        InputError: ``not-a-plan`` if it is no number above 0, ``unknown-preset``.
    """
    value = plan.parameters["playback"].get(name, getattr(plan_preset(plan).playback, name))
    return _checked_number(value, f"playback.{name}")


def is_on_table(plan: Plan) -> bool:
    """Return True if the plan is one for a table."""
    return plan.parameters.get("world", FLOATING) == "table"


def plan_parameters(plan: Plan, module_size: float | None) -> Parameters:
    """Return the plan's own parameters, as far as a certificate depends on them.

    Raises:
        InputError: ``not-a-plan`` if they are invalid, ``unknown-preset``.
    """
    names = ("module_size", "density_kg_m3", "joint_speed_limit_rad_s", "joint_error_rad")
    plain = {
        name: _checked_number(plan.parameters[name], name)
        for name in names
        if name in plan.parameters
    }
    parameters_found = _on_its_table(replace(plan_preset(plan), **plain), plan)
    return (
        parameters_found
        if module_size is None
        else replace(parameters_found, module_size=module_size)
    )


def _on_its_table(parameters: Parameters, plan: Plan) -> Parameters:
    """Return the parameters with the world of a plan, and those of its table.

    Raises:
        InputError: ``not-a-plan`` if they are invalid.
    """
    world = plan.parameters.get("world", FLOATING)
    if world == FLOATING:
        return parameters
    if world not in WORLD_CHOICES:
        raise InputError(
            "not-a-plan",
            f"got {world!r} in parameters.world of plan.npz, expected one of: "
            f"{', '.join(WORLD_CHOICES)}.",
        )
    table_values = plan.parameters.get("table", {})
    friction = table_values.get("table_friction", parameters.table.table_friction)
    base = table_values.get("table_base", parameters.table.table_base)
    if base not in get_args(Base):
        raise InputError(
            "not-a-plan",
            f"got {base!r} in parameters.table.table_base of plan.npz, expected one of: "
            f"{', '.join(get_args(Base))}.",
        )
    table = replace(
        parameters.table,
        table_base=base,
        table_friction=friction and _checked_number(friction, "table.table_friction"),
        table_torque=_checked_number(
            table_values.get("table_torque", parameters.table.table_torque), "table.table_torque"
        ),
    )
    return replace(parameters, world=world, table=table)


def plan_preset(plan: Plan) -> Parameters:
    """Return the preset that a plan names.

    Raises:
        InputError: ``unknown-preset``.
    """
    try:
        return preset(plan.preset)
    except InputError as error:
        raise named(error, PLAN) from None


def _checked_number(value: Any, name: str) -> float:
    """Return a parameter that is a number above 0.

    Raises:
        InputError: ``not-a-plan`` if it is not.
    """
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not (number and 0.0 < value < float("inf")):
        raise InputError(
            "not-a-plan",
            f"got {value!r} in parameters.{name} of plan.npz, expected a number above 0.",
        )
    return value


def request_differs(directory: FilePath, plan: Plan, notes: list[str]) -> Differences:
    """Yield the differences of the plan's parameters from those of the request.

    A plan without a parameter, which a later version added, means its default.
    """
    if not (directory / REQUEST).exists():
        notes.append(
            "There is no request.json, so the plan's parameters were not compared with it."
        )
        return
    try:
        request = Workspace(directory).read_request()
        request.check()
        smoothed = plan.smoothing is not None
        parameters = request.parameters(plan.chain.module, smoothed=smoothed)
    except (*UNREADABLE, PlannerError) as error:
        yield f"request.json cannot be read ({error})"
        return
    stated = {"seed": plan.seed, "preset": plan.preset}
    stated["refold"] = plan.start is not None
    if not (smoothed and request.prefer != COMPUTING):  # the best plan may be a smoothed one
        stated["smooth"] = smoothed
    yield from value_differences(
        {n: getattr(request, n) for n in stated}, stated, versus_plan(REQUEST, "request")
    )
    installed, plan_version = versions().get("foldback"), plan.versions.get("foldback")
    different = value_differences(
        with_defaults(plan.parameters, parameters), asdict(parameters), "plan.npz parameters"
    )
    if installed == plan_version:
        yield from different
    else:
        notes += [
            f"{field}, as in foldback {installed}; the plan was made by foldback {plan_version}."
            for field in different
        ]
