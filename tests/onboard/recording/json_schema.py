"""Checks JSON values against the part of JSON Schema that our logs use."""

from __future__ import annotations

import math
import re
from typing import Any, Final

_TYPES: Final[dict[str, type | tuple[type, ...]]] = {
    "object": dict,
    "array": list,
    "string": str,
    "boolean": bool,
    "integer": int,
    "number": (int, float),
    "null": type(None),
}


def complaints(value: Any, schema: dict[str, Any], where: str = "$") -> list[str]:
    """Return how a value deviates from its schema, and every property that the schema lacks."""
    allowed = [schema["type"]] if isinstance(schema["type"], str) else schema["type"]
    if not any(_is(value, name) for name in allowed):
        return [f"{where}: {value!r} is not {' or '.join(allowed)}"]
    if isinstance(value, dict) and "properties" in schema:
        return _object_complaints(value, schema, where)
    if isinstance(value, list):
        if not schema.get("minItems", 0) <= len(value) <= schema.get("maxItems", math.inf):
            return [f"{where}: {len(value)} items"]
        items = schema["items"]
        return [c for i, item in enumerate(value) for c in complaints(item, items, f"{where}[{i}]")]
    return []


def _is(value: Any, name: str) -> bool:
    if isinstance(value, bool):
        return name == "boolean"
    return isinstance(value, _TYPES[name])


def _object_complaints(value: dict[str, Any], schema: dict[str, Any], where: str) -> list[str]:
    found = []
    for key, item in value.items():
        patterns = schema.get("patternProperties", {})
        matching = [node for pattern, node in patterns.items() if re.search(pattern, key)]
        if key in schema["properties"]:
            matching.append(schema["properties"][key])
        if not matching:
            found.append(f"{where}: {key} is unknown")
        for node in matching:
            found += complaints(item, node, f"{where}.{key}")
    return found
