"""Puts a mutant into a process that has already imported and collected everything.

Every function holds its compiled code in one place for all modules that import it: exchanging that
is enough.  What an import computes (constants, defaults, class bodies) needs a new import.
"""

from __future__ import annotations

import ast
import functools
import gc
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

# The top-level packages that are imported again.
OURS = ("onboard", "sitl", "gcs_tools", "tests")

Places = dict[tuple[str, int], CodeType]


@dataclass(frozen=True)
class Holders:
    """What holds code of some files in this process, found once: looking for it takes a while.

    Attributes:
        functions: by the absolute path of their file.
        caches: of ours, by `functools.cache`.
    """

    functions: dict[str, list[FunctionType]] = field(default_factory=dict)
    caches: list[functools._lru_cache_wrapper[object]] = field(default_factory=list)

    @classmethod
    def of(cls, paths: Iterable[str]) -> Holders:
        """Find the functions of some files, before `gc.freeze` hides them."""
        functions: dict[str, list[FunctionType]] = {path: [] for path in paths}
        caches = []
        for found in gc.get_objects():
            if isinstance(found, FunctionType) and found.__code__.co_filename in functions:
                functions[found.__code__.co_filename].append(found)
            elif isinstance(found, functools._lru_cache_wrapper) and _is_ours(found.__module__):
                caches.append(found)
        return cls(functions, caches)

    def exchange(self, path: Path, old: Places, after: ast.Module) -> bool:
        """Give every function of a file its changed code; tell whether one holds the change.

        Args:
            path: of the file.
            old: its code, by `codes_of`.
            after: the file, changed.
        """
        new = codes_of(path, after)
        if old.keys() != new.keys():
            return False
        places = {code: place for place, code in old.items()}
        exchanged = False
        for function in self.functions[str(path)]:
            place = places.get(function.__code__)
            if place is None:
                continue
            if function.__code__.co_freevars != new[place].co_freevars:
                return False
            exchanged |= function.__code__ != new[place]
            function.__code__ = new[place]
        return exchanged

    def clear_caches(self) -> None:
        """Forget what `functools.cache` remembers of our functions."""
        for cache in self.caches:
            cache.cache_clear()


def codes_of(path: Path, tree: ast.Module) -> Places:
    """Compile a file; return the code of each function by where it stands."""
    return dict(_functions(compile(tree, str(path), "exec", dont_inherit=True)))


def _functions(code: CodeType, within: str = "") -> Iterator[tuple[tuple[str, int], CodeType]]:
    """Yield each code object below one, by its qualified name and its number there."""
    for number, constant in enumerate(
        each for each in code.co_consts if isinstance(each, CodeType)
    ):
        place = f"{within}/{constant.co_name}", number
        yield place, constant
        yield from _functions(constant, f"{place[0]}#{number}")


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
