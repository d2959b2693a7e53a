"""Puts a mutant into a process that has already imported and collected everything.

Every function holds its compiled code in one place, whoever has imported it: exchanging that is
enough.  What an import computes (constants, defaults, class bodies) needs a new import.
"""

from __future__ import annotations

import ast
import functools
import gc
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

# The top-level packages that are imported again.
OURS = ("onboard", "sitl", "gcs_tools", "tests")

Places = dict[tuple[str, int], CodeType]


def exchange(path: Path, before: ast.Module, after: ast.Module) -> bool:
    """Give every function of a file its changed code; tell whether the change is in one of them."""
    old, new = (
        dict(_functions(compile(tree, str(path), "exec", dont_inherit=True)))
        for tree in (before, after)
    )
    if old.keys() != new.keys():
        return False
    places = {code: place for place, code in old.items()}
    exchanged = False
    for found in gc.get_objects():
        if isinstance(found, FunctionType) and found.__code__.co_filename == str(path):
            place = places.get(found.__code__)
            if place is None:
                continue
            if found.__code__.co_freevars != new[place].co_freevars:
                return False
            exchanged |= found.__code__ != new[place]
            found.__code__ = new[place]
    return exchanged


def _functions(code: CodeType, within: str = "") -> Iterator[tuple[tuple[str, int], CodeType]]:
    """Yield each code object below one, by its qualified name and its number there."""
    for number, constant in enumerate(
        each for each in code.co_consts if isinstance(each, CodeType)
    ):
        place = f"{within}/{constant.co_name}", number
        yield place, constant
        yield from _functions(constant, f"{place[0]}#{number}")


def clear_caches() -> None:
    """Forget what `functools.cache` remembers of our functions."""
    for found in gc.get_objects():
        if isinstance(found, functools._lru_cache_wrapper) and _is_ours(found.__module__):
            found.cache_clear()


def _is_ours(module: str | None) -> bool:
    return (module or "").partition(".")[0] in OURS


class ChangedFile(importlib.abc.MetaPathFinder):
    """Imports one file with a change, and everything else as it is.

    Args:
        path: of the file.
        root: of the repository.
        tree: the file, changed.
    """

    def __init__(self, path: Path, root: Path, tree: ast.Module) -> None:
        self._name = ".".join(path.relative_to(root).with_suffix("").parts)
        self._path, self._tree = path, tree

    def import_again(self) -> None:
        """Drop every module of ours, so that the change takes effect when they are imported."""
        for name in [name for name in sys.modules if _is_ours(name)]:
            del sys.modules[name]
        sys.meta_path.insert(0, self)

    def find_spec(
        self, name: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """Return the changed file if that is imported."""
        del path, target
        if name != self._name:
            return None
        loader = _Compiled(name, str(self._path))
        loader.tree = self._tree
        return importlib.util.spec_from_file_location(name, self._path, loader=loader)


class _Compiled(importlib.machinery.SourceFileLoader):
    tree: ast.Module

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.tree, self.get_filename(fullname), "exec", dont_inherit=True)
