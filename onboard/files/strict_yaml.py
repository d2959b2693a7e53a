"""YAML in which every value has one meaning: the core schema of YAML 1.2, less what is ambiguous.

PyYAML reads YAML 1.1, in which ``1e3`` is a word, ``014`` is twelve, ``1:30`` is ninety and
``2026-13-45`` raises an internal error.  Here numbers are decimal, and a value that two versions of
YAML read differently is refused.  See https://yaml.org/spec/1.2.2/#103-core-schema.
"""

from __future__ import annotations

import math
import re
from typing import TYPE_CHECKING, Any, ClassVar, Final

import yaml

if TYPE_CHECKING:
    from collections.abc import Callable

# Our own files have five levels; a parser that follows every bracket runs out of stack.
DEPTH_MAX: Final = 40
# Aliases of aliases grow exponentially; what a few of them share stays far below this.
ALIASED_VALUES_MAX: Final = 100_000
_DIGITS_MAX: Final = 18

_TAG: Final = "tag:yaml.org,2002:"
_MERGE: Final = f"{_TAG}merge"
_AMBIGUOUS: Final = "tag:clearway:ambiguous"

_INT: Final = re.compile(r"[-+]?(?:0|[1-9][0-9]*)$")
_FLOAT: Final = re.compile(
    r"""[-+]?(?:\.[0-9]+|[0-9]+\.[0-9]*)(?:[eE][-+]?[0-9]+)?$
    |[-+]?[0-9]+[eE][-+]?[0-9]+$
    |[-+]?\.(?:inf|Inf|INF)$
    |\.(?:nan|NaN|NAN)$""",
    re.VERBOSE,
)
# What some version of YAML takes for a number in another base, with another grouping, or a date.
_OTHER: Final = re.compile(
    r"""[-+]?0[0-9_]+$
    |[-+]?0[xob][0-9a-fA-F_]+$
    |[-+]?(?=[0-9_.]*_)[0-9][0-9_]*(?:\.[0-9_]*)?(?:[eE][-+]?[0-9]+)?$
    |[-+]?[0-9][0-9_]*(?::[0-9]{1,2})+(?:\.[0-9_]*)?$
    |[0-9]{4}-[0-9]{1,2}-[0-9]{1,2}(?:(?:[Tt]|[ \t]+)[0-9].*)?$""",
    re.VERBOSE,
)

_RESOLVERS: Final = (
    (f"{_TAG}null", re.compile(r"(?:~|null|Null|NULL|)$"), "~nN\0"),
    (f"{_TAG}bool", re.compile(r"(?:true|True|TRUE|false|False|FALSE)$"), "tTfF"),
    (f"{_TAG}int", _INT, "-+0123456789"),
    (f"{_TAG}float", _FLOAT, "-+.0123456789"),
    (_AMBIGUOUS, _OTHER, "-+0123456789"),
    (_MERGE, re.compile(r"<<$"), "<"),
)


class UnclearValueError(yaml.YAMLError):
    """Correct YAML that could be misread; the message is one line with line, key and value.

    Attributes:
        reason: the same without the line.
    """

    def __init__(self, line: int, reason: str) -> None:
        super().__init__(f"line {line}: {reason}")
        self.reason = reason


def load(text: str) -> Any:
    """Read one document.

    Raises:
        UnclearValueError: a value or key that is ambiguous, nested too deeply or too large.
        yaml.YAMLError: not YAML.
    """
    return yaml.load(text, Loader=_Loader)  # noqa: S506  it constructs values, never objects


def dump(document: Any) -> str:
    """Return a document as text that `load` reads as the same values, keys in their order."""
    text: str = yaml.dump(document, Dumper=_Dumper, sort_keys=False, allow_unicode=True)
    return text


def _implicit_resolvers() -> dict[str | None, list[tuple[str, re.Pattern[str]]]]:
    resolvers: dict[str | None, list[tuple[str, re.Pattern[str]]]] = {}
    for tag, pattern, first_characters in _RESOLVERS:
        for first in first_characters:
            # PyYAML looks an empty scalar up by the empty string.
            resolvers.setdefault(first.strip("\0"), []).append((tag, pattern))
    return resolvers


class _Dumper(yaml.SafeDumper):
    """Quotes the words that `_Loader` would take for something else."""

    yaml_implicit_resolvers: ClassVar = _implicit_resolvers()  # type: ignore[misc]  # as in PyYAML


class _Loader(yaml.SafeLoader):
    """Makes null, booleans, numbers, words, lists and mappings; checks the document before."""

    yaml_implicit_resolvers: ClassVar = _implicit_resolvers()  # type: ignore[misc]  # as in PyYAML
    yaml_constructors: ClassVar[dict[str | None, Callable[[_Loader, Any], Any]]] = {
        f"{_TAG}null": yaml.SafeLoader.construct_yaml_null,
        f"{_TAG}bool": yaml.SafeLoader.construct_yaml_bool,
        f"{_TAG}int": lambda loader, node: int(loader.construct_scalar(node)),
        f"{_TAG}float": lambda loader, node: _float(loader.construct_scalar(node)),
        f"{_TAG}str": yaml.SafeLoader.construct_yaml_str,
        f"{_TAG}seq": yaml.SafeLoader.construct_yaml_seq,
        f"{_TAG}map": yaml.SafeLoader.construct_yaml_map,
    }

    def __init__(self, stream: str) -> None:
        super().__init__(stream)
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        """Compose a node, unless it is nested too deeply."""
        if self._depth > DEPTH_MAX:
            event = self.peek_event()  # type: ignore[no-untyped-call]
            line = event.start_mark.line + 1
            raise UnclearValueError(line, f"nested more than {DEPTH_MAX} levels deep")
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def get_single_node(self) -> yaml.Node | None:
        """Return the document, checked."""
        node: yaml.Node | None = super().get_single_node()
        if node is not None:
            _Inspection().inspect(node, "")
        return node


def _float(text: str) -> float:
    """Read a float as YAML writes it: ``.inf`` and ``.nan`` have a point, Python's have none."""
    sign = "-" if text.startswith("-") else ""
    digits = text.lstrip("+-").lower()
    return float(sign + digits.lstrip(".")) if digits in {".inf", ".nan"} else float(text)


class _Inspection:
    """Checks every node of a document once, before values are made of it."""

    def __init__(self) -> None:
        # Values below each node, aliases expanded; None while it is being looked at.
        self._sizes: dict[int, int | None] = {}
        self._aliased = 0

    def inspect(self, node: yaml.Node, key: str) -> int:
        """Return how many values a node stands for.

        Args:
            node: to look at.
            key: dotted path to it, for errors.

        Raises:
            UnclearValueError: says where and why.
        """
        if id(node) in self._sizes:
            return self._again(node, key)
        self._sizes[id(node)] = None
        if node.tag not in _TAGS:
            raise _unclear(node, key, f"{_shown(_tag_name(node.tag))} is not used in these files")
        size = 1
        if isinstance(node, yaml.MappingNode):
            size += self._mapping(node, key)
        elif isinstance(node, yaml.SequenceNode):
            size += sum(self.inspect(item, f"{key}.{n}") for n, item in enumerate(node.value))
        elif isinstance(node, yaml.ScalarNode):
            _check_scalar(node, key)
        self._sizes[id(node)] = size
        return size

    def _again(self, node: yaml.Node, key: str) -> int:
        size = self._sizes[id(node)]
        if size is None:
            raise _unclear(node, key, "contains itself")
        self._aliased += size
        if self._aliased > ALIASED_VALUES_MAX:
            raise _unclear(node, key, f"aliases repeat more than {ALIASED_VALUES_MAX:,} values")
        return size

    def _mapping(self, node: yaml.MappingNode, key: str) -> int:
        seen: set[tuple[str, str]] = set()
        size = 0
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise _unclear(key_node, key, f"a key must be a word, not a {_kind(key_node)}")
            _check_scalar(key_node, key)
            if key_node.tag == _MERGE:
                _check_merged(value_node, key)
            name = (key_node.tag, key_node.value)
            if name in seen:
                raise _unclear(key_node, key, f"key {key_node.value!r} is given twice")
            seen.add(name)
            size += self.inspect(value_node, f"{key}.{key_node.value}")
        return size


_TAGS: Final = frozenset(tag for tag in _Loader.yaml_constructors if tag) | {_AMBIGUOUS}


def _tag_name(tag: str) -> str:
    if tag == _MERGE:
        return "<< outside a mapping"
    return f"tag {tag.replace(_TAG, '!!')}"


def _check_scalar(node: yaml.ScalarNode, key: str) -> None:
    text = node.value
    if node.tag == _AMBIGUOUS:
        reason = "write a decimal number, or quote it if it is a word"
        raise _unclear(node, key, f"{_shown(text)} has more than one meaning in YAML: {reason}")
    pattern = {f"{_TAG}int": _INT, f"{_TAG}float": _FLOAT}.get(node.tag)
    if pattern is None:
        return
    if pattern.match(text) is None and not (pattern is _FLOAT and _INT.match(text)):
        raise _unclear(node, key, f"{_shown(text)} is not a number")
    infinite = pattern is _FLOAT and "inf" not in text.lower() and math.isinf(_float(text))
    if infinite or (pattern is _INT and len(text) > _DIGITS_MAX):
        raise _unclear(node, key, f"{_shown(text)} is too large a number")


def _check_merged(node: yaml.Node, key: str) -> None:
    parts = node.value if isinstance(node, yaml.SequenceNode) else [node]
    if not all(isinstance(part, yaml.MappingNode) for part in parts):
        raise _unclear(node, key, "<< takes a mapping, or a list of mappings")


def _unclear(node: yaml.Node, key: str, reason: str) -> UnclearValueError:
    key = key.lstrip(".")
    line = node.start_mark.line + 1
    return UnclearValueError(line, f"{_shown(key)}: {reason}" if key else reason)


def _kind(node: yaml.Node) -> str:
    return "list" if isinstance(node, yaml.SequenceNode) else "mapping"


def _shown(text: str) -> str:
    return text if len(text) <= 40 else f"{text[:37]}..."
