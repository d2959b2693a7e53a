"""How the process uses its memory: what is collected, and what goes back to the system."""

from __future__ import annotations

import ctypes
import gc
from typing import Final

# Parameters of mallopt in glibc's <malloc.h>.
_M_TRIM_THRESHOLD: Final = -1
_M_MMAP_THRESHOLD: Final = -3
_THRESHOLD_BYTES: Final = 128 * 1024


def return_freed_arrays() -> bool:
    """Have freed arrays go back to the system at once, so that memory is what is in use.

    glibc raises its thresholds with the largest array that was ever freed.  From then on the arrays
    of a plan lie among lasting objects, and memory rises and falls by 5 MB for hours.

    Returns:
        Whether the C library takes these parameters; another one than glibc does not.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return False
    parameters = (_M_MMAP_THRESHOLD, _M_TRIM_THRESHOLD)
    taken = [mallopt(each, _THRESHOLD_BYTES) == 1 for each in parameters]
    return all(taken)


def freeze_gc_heap() -> None:
    """Exclude everything allocated so far from later garbage collections.

    A collection that visits every imported module takes several ticks on a small computer.
    """
    gc.collect()
    gc.freeze()
