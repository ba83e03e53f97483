"""Forms: dependencies that read requests from form fields, one for each option."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from inspect import Parameter, Signature
from typing import Annotated, Any, TypeVar

from fastapi import Form

from planner.parameters.option import Option, options_of
from planner.pathfinding.path_options import PathOptions

RequestT = TypeVar("RequestT", bound=PathOptions)


def form_of(request: type[RequestT]) -> Callable[..., Awaitable[RequestT]]:
    """Return the dependency that reads a request from a form with a field for each option."""

    async def read(**given: Any) -> RequestT:
        return request.of(**given)

    parameters = [
        Parameter(
            name,
            Parameter.KEYWORD_ONLY,
            default=each.default,
            annotation=Annotated[each.annotation, field(each)],
        )
        for name, each in options_of(request).items()
    ]
    vars(read)["__signature__"] = Signature(parameters)
    return read


def field(option: Option) -> Any:
    """Return an option as a field of a form, with its description for the API."""
    low, high = option.range or (None, None)
    return Form(
        ge=low,
        le=high,
        pattern=option.pattern,
        description=option.meaning or None,
        # The planner refuses longer values with its own message.
        json_schema_extra={"maxLength": option.max_chars} if option.max_chars else None,
    )
