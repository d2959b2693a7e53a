"""Number types of logged records, and the JSON Schemas under which a log announces them.

A record is a dataclass: pydantic serializes and validates it, and its schema is derived from it.
"""

from __future__ import annotations

from typing import Annotated, Any, Final

from pydantic import Field, TypeAdapter

Schema = dict[str, Any]  # a JSON Schema, as published

# A number that JSON can express.
Number = Annotated[float, Field(allow_inf_nan=False)]
# Unix time in seconds, 1970 to 2286.
UnixTime = Annotated[float, Field(ge=0.0, le=1e10)]
Vector2 = tuple[Number, Number]
Vector3 = tuple[Number, Number, Number]

_SCALARS: Final = frozenset({"boolean", "integer", "number", "object", "string"})


def record_schema(record_type: type[Any], title: str) -> Schema:
    """Return the JSON Schema of a record, in the form that log viewers accept.

    Foxglove and Lichtblick refuse a topic with a ``$ref``, a property that may be null, or an array
    of arrays among its ``properties``.  References are therefore expanded, and such properties
    stand under ``patternProperties``, which viewers ignore and validators apply.

    Args:
        record_type: a dataclass or another type that pydantic can serialize to a JSON object.
        title: the name of the schema.
    """
    raw = TypeAdapter(record_type).json_schema(mode="serialization")
    return {"title": title, **_expanded(raw, raw.get("$defs", {}))}


def _expanded(node: Schema, definitions: Schema) -> Schema:
    """Return a schema node without references, titles, defaults and descriptions."""
    if "$ref" in node:
        return _expanded(definitions[node["$ref"].rpartition("/")[2]], definitions)
    if "anyOf" in node:  # pydantic writes an optional value so, and nothing else of ours
        value, null = (_expanded(each, definitions) for each in node["anyOf"])
        return {**value, "type": [value["type"], null["type"]]}
    if "properties" in node:
        return _object({k: _expanded(v, definitions) for k, v in node["properties"].items()})
    if node.get("type") == "array":
        return _array(node, definitions)
    return {"type": node.get("type", "object")}  # any JSON value is an object here


def _array(node: Schema, definitions: Schema) -> Schema:
    if "prefixItems" not in node:
        return {"type": "array", "items": _expanded(node["items"], definitions)}
    # A tuple of equal types.
    items, count = _expanded(node["prefixItems"][0], definitions), len(node["prefixItems"])
    return {"type": "array", "items": items, "minItems": count, "maxItems": count}


def _object(properties: Schema) -> Schema:
    shown = {name: node for name, node in properties.items() if _viewers_accept(node)}
    hidden = {f"^{name}$": node for name, node in properties.items() if name not in shown}
    schema: Schema = {"type": "object", "properties": shown}
    if hidden:
        schema["patternProperties"] = hidden
    return schema


def _viewers_accept(node: Schema) -> bool:
    if node["type"] == "array":
        return node["items"]["type"] in _SCALARS
    return isinstance(node["type"], str)
