"""JSON bodies of requests: decoded in a thread, up to the first fault.

A body is a dependency of its route. Dependencies are resolved in the order of the parameters, so a
route that names its fold and owner first looks at no body of a stranger.
"""

from __future__ import annotations

import asyncio
import re
from typing import Any, Final

import msgspec
from fastapi import Depends, Request
from pydantic import BaseModel

from server.errors import ServiceError, Unusable

JSON_MEDIA_TYPE: Final = "application/json"
PLACE: Final = re.compile(r"(?: - at `\$(?P<place>[\w.]*)[^`]*`)?$")
"""Matches the place in the body at the end of a message of msgspec."""
UNKNOWN_FIELD: Final = re.compile(r"unknown field `(\w{1,40})`")


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
    where = "body" + (place["place"] or "")
    if (unknown := UNKNOWN_FIELD.search(message)) is not None:
        where = f"{where}.{unknown[1]}"
    detail = message[: place.start()].replace("`", "")
    return Unusable("bad-request", f"{detail}.", where=where)
