"""Parse a JSON payload into a model; an error is one line that names the offending key."""

from __future__ import annotations

from typing import TypeVar

from pydantic import BaseModel, ValidationError

M = TypeVar("M", bound=BaseModel)


class MalformedPayloadError(ValueError):
    """A payload that is not JSON, or does not have the form that its key requires."""


def parse(payload: bytes, model: type[M]) -> M:
    """Read a payload.

    Raises:
        MalformedPayloadError: not JSON, or not of this model; names the first offending key.
    """
    try:
        return model.model_validate_json(payload)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(map(str, first["loc"])) or "payload"
        raise MalformedPayloadError(f"{place}: {first['msg']}") from error
