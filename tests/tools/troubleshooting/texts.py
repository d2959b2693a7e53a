"""Finds in the code what the service and the pre-flight check can say."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import zip_longest
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[3]
# What stands in a text in place of a number or a name.
GAP: Final = "…"
# What has fewer words is a name.
_WORDS_MIN: Final = 3
# Calls that make a check, and which of their arguments is its name.
_MAKERS: Final = {
    "Finding": 1,
    "Rule": 0,
    "Clause": 0,
    "_known": 0,
    "_unknown": 0,
    "finding": 0,
    "_none_of": 1,
    "_age_finding": 1,
}
# Which argument of a call is the text; in a tuple the last element is.
_TEXT_OF: Final = {"Refusal": 1, "Event": 3}
_Function = ast.FunctionDef | ast.AsyncFunctionDef


def texts_of(enumeration: str, package: str = "onboard") -> dict[str, list[str]]:
    """Return the texts that stand beside each member of an enumeration, by the member's name.

    Args:
        enumeration: name of the class, such as ``RefusalKind``.
        package: to search.
    """
    found: dict[str, set[str]] = {}
    for _, function in _functions(package, f"{enumeration}."):
        for node, assigned in _with_assigned(function):
            position = None
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                parts, position = node.args, _TEXT_OF.get(node.func.id)
            elif isinstance(node, ast.Tuple):
                parts, position = node.elts, len(node.elts) - 1
            if position is None or position >= len(parts):
                continue
            for member in _members(parts, enumeration):
                text = _text(parts[position], assigned)
                found.setdefault(member, set()).update([] if text is None else [text])
    return {member: sorted(said) for member, said in found.items()}


def sentences_in(module: str, *functions: str) -> list[str]:
    """Return every text of three or more words in functions of a module; no docstrings."""
    found: dict[str, None] = {}
    for _, function in _functions(module):
        if function.name not in functions:
            continue
        told = {id(part) for node in ast.walk(function) for part in _parts(node)}
        for node in sorted(_located(function), key=lambda node: node.lineno):
            text = None if id(node) in told else _text(node, {})
            if text is not None and len(text.replace(GAP, " ").split()) >= _WORDS_MIN:
                found[text] = None
    return list(found)


def check_names(package: str = "gcs_tools/preflight") -> set[str]:
    """Return the name of every finding, rule and clause that a package makes.

    Of a name that begins with a sensor's, the rest.  A name that is neither a literal nor a
    variable that was assigned one is where it is made: ``module.py:function``.
    """
    found: set[str] = set()
    for path, function in _functions(package):
        where = f"{path.name}:{function.name}"
        for node, assigned in _with_assigned(function):
            name = None
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                position = _MAKERS.get(node.func.id, len(node.args))
                name = node.args[position] if position < len(node.args) else None
            elif isinstance(node, ast.Yield) and isinstance(node.value, ast.Tuple):
                name = node.value.elts[0]
            if name is not None:
                text = (_text(name, assigned) or where).removeprefix(f"{GAP} ")
                found.add(where if text == GAP else text)
    return found


def _functions(package: str, mentioning: str = "") -> Iterator[tuple[Path, _Function]]:
    """Yield the functions of a package or module whose source mentions a name."""
    place = ROOT / package
    for path in [place] if place.is_file() else sorted(place.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        if mentioning not in source:
            continue
        nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, _Function)]
        yield from ((path, node) for node in nodes if _mentions(source, node, mentioning))


def _mentions(source: str, function: _Function, name: str) -> bool:
    return name in "\n".join(source.split("\n")[function.lineno - 1 : function.end_lineno])


def _with_assigned(function: _Function) -> Iterator[tuple[ast.AST, dict[str, str]]]:
    """Yield each node of a function, with the texts that its variables have there."""
    assigned: dict[str, str] = {}
    for node in _located(function):
        for target, value in _assignments(node):
            text = None if value is None else _text(value, assigned)
            assigned.pop(target, None)
            if text is not None:
                assigned[target] = text
        yield node, assigned


def _located(function: _Function) -> list[ast.expr | ast.stmt]:
    """Return the nodes of a function in the order of its lines; an assignment before its use."""
    nodes = [node for node in ast.walk(function) if isinstance(node, ast.expr | ast.stmt)]
    return sorted(nodes, key=lambda node: (node.lineno, not isinstance(node, ast.Assign)))


def _assignments(node: ast.AST) -> Iterator[tuple[str, ast.expr | None]]:
    """Yield the variables that a node assigns, and what; None where a loop does."""
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
        yield node.targets[0].id, node.value
    elif isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
        values = node.value.elts if isinstance(node.value, ast.Tuple) else []
        for target, value in zip_longest(node.targets[0].elts, values):
            if isinstance(target, ast.Name):
                yield target.id, value
    elif isinstance(node, ast.For):
        yield from ((each.id, None) for each in ast.walk(node.target) if isinstance(each, ast.Name))
    elif isinstance(node, ast.ListComp | ast.GeneratorExp):
        targets = [name for each in node.generators for name in ast.walk(each.target)]
        yield from ((each.id, None) for each in targets if isinstance(each, ast.Name))


def _members(parts: list[ast.expr], enumeration: str) -> Iterator[str]:
    for part in parts:
        if isinstance(part, ast.Attribute) and ast.unparse(part.value) == enumeration:
            yield part.attr


def _parts(node: ast.AST) -> list[ast.AST]:
    """Return the constants to leave out: parts of other texts, and docstrings."""
    if isinstance(node, ast.JoinedStr):
        return list(node.values)
    if isinstance(node, ast.Expr):
        return [node.value]
    return []


def _text(node: ast.AST, assigned: dict[str, str]) -> str | None:
    """Return a literal text with gaps for what is computed; None for anything else."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.Name):
        return assigned.get(node.id)
    if isinstance(node, ast.JoinedStr):
        return "".join(
            str(part.value) if isinstance(part, ast.Constant) else GAP for part in node.values
        )
    return None
