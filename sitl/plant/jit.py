"""Optional compilation of the plant's inner loop.

With Numba installed the physics runs as machine code, compiled once and kept on disk; without it
the very same functions run as plain Python, only slower.  Compiled functions therefore take and
return floats and named tuples of floats, which are fast either way.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

numba: Any
try:
    import numba
except ImportError:  # the `sitl` extra is not installed
    numba = None

P = ParamSpec("P")
R = TypeVar("R")


def compiled(function: Callable[P, R]) -> Callable[P, R]:
    """Return ``function`` compiled when Numba is available, else ``function`` itself."""
    if numba is None:
        return function
    default = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = _CACHE_DIRECTORY
    try:
        return cast("Callable[P, R]", numba.njit(cache=True, error_model="numpy")(function))
    except RuntimeError:  # no writable cache directory: compile on every run
        return cast("Callable[P, R]", numba.njit(error_model="numpy")(function))
    finally:
        numba.config.CACHE_DIR = default


def _cache_directory() -> str:
    """Return a cache directory that changes with the sources.

    Numba notices a change of the file that holds a function, but not of the files that it calls.
    """
    digest = hashlib.sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    cache_home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return str(cache_home / "clearway" / f"numba-{digest.hexdigest()[:16]}")


_CACHE_DIRECTORY = _cache_directory()
