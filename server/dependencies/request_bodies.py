"""Request bodies: dependencies that read forms, one field for each option, and JSON.

JSON is decoded in a thread, up to the first fault. Dependencies are resolved in the order of the
parameters, so a route that names its fold and owner first looks at no body of a stranger.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Awaitable, Callable
from inspect import Parameter, Signature
from typing import Annotated, Any, Final, TypeVar

import msgspec
from fastapi import Depends, Form, Request
from pydantic import BaseModel

from foldback.planner.parameters.option import Option, options_of
from foldback.planner.pathfinding.path_options import PathOptions
from foldback.server.errors import ServiceError, Unusable

RequestT = TypeVar("RequestT", bound=PathOptions)
JSON_MEDIA_TYPE: Final = "application/json"
PLACE: Final = re.compile(r"(?: - at `\$(?P<place>[\w.]*)[^`]*`)?$")
"""Matches the place in the body at the end of a message of msgspec."""
UNKNOWN_FIELD: Final = re.compile(r"unknown field `(\w{1,40})`")


def form_of(request: type[RequestT]) -> Callable[..., Awaitable[RequestT]]:
    """Return the dependency that reads a request from a form with a field for each option."""

    async def read(**fields: Any) -> RequestT:
        return request.of(**fields)

    parameters = [
        Parameter(
            name,
            Parameter.KEYWORD_ONLY,
            default=option.default,
            annotation=Annotated[option.annotation, field(option)],
        )
        for name, option in options_of(request).items()
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


def json_body(kind: type) -> Any:
    """Return the dependency that reads the body of a request; an empty one is an empty object.

    Args:
        kind: Type of the body: a structure of msgspec, or a dictionary.
    """
    decoder: msgspec.json.Decoder[Any] = msgspec.json.Decoder(kind)

    async def read(request: Request) -> Any:
        media_type = request.headers.get("content-type", JSON_MEDIA_TYPE).partition(";")[0]
        if media_type.strip().lower() != JSON_MEDIA_TYPE:
            detail = f"got a body of type {media_type[:40]!r}, expected {JSON_MEDIA_TYPE}."
            raise Unusable("bad-request", detail, where="body")
        body = await request.body() or b"{}"
        return await asyncio.to_thread(_decoded, decoder, body)

    return Depends(read)


def described(kind: type[msgspec.Struct] | type[BaseModel]) -> dict[str, Any]:
    """Return what OpenAPI says of the body of a route, as its ``openapi_extra``.

    Args:
        kind: Type of the body, or the model of a response that describes it, too.
    """
    name = kind.__name__
    if issubclass(kind, msgspec.Struct):
        schema = msgspec.json.schema_components([kind])[1][name]
    else:
        schema = {"$ref": f"#/components/schemas/{name}"}
    return {"requestBody": {"content": {JSON_MEDIA_TYPE: {"schema": schema}}}}


def _decoded(decoder: msgspec.json.Decoder[Any], body: bytes) -> Any:
    try:
        return decoder.decode(body)
    except RecursionError:
        raise Unusable("bad-request", "The body is nested too deeply.", where="body") from None
    except UnicodeDecodeError:
        raise Unusable("bad-request", "The body is not UTF-8 text.", where="body") from None
    except msgspec.MsgspecError as error:
        raise _refusal(str(error)) from None


def _refusal(message: str) -> ServiceError:
    """Return the refusal with the words of msgspec, such as "Expected `int`, got `str`"."""
    place = PLACE.search(message)
    assert place is not None
    place_text = "body" + (place["place"] or "")
    if (unknown := UNKNOWN_FIELD.search(message)) is not None:
        place_text = f"{place_text}.{unknown[1]}"
    detail = message[: place.start()].replace("`", "")
    return Unusable("bad-request", f"{detail}.", where=place_text)
