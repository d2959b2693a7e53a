"""Memory that is freed goes back to the system, in a process of its own."""

from __future__ import annotations

import gc
import os
import subprocess
import sys

import pytest

from onboard.heap import freeze_gc_heap, return_freed_arrays

# A large array that is freed raises glibc's thresholds.  Arrays of a plan, each followed by
# something that lasts, are then freed below it.
_ARRAYS_COME_AND_GO = """
import sys
import numpy as np
from onboard.heap import return_freed_arrays

def resident_mb():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6

if sys.argv[1] == "returned":
    assert return_freed_arrays()
large = np.ones(1_000_000)
del large
before_mb = resident_mb()
arrays, lasting = [], []
for _ in range(40):
    arrays.append(np.ones(100_000))
    lasting.append(np.ones(3_000))
arrays.clear()
print(resident_mb() - before_mb)
"""


def kept_mb(case: str) -> float:
    """Return what the process keeps after its arrays of 32 MB in all were freed."""
    # A cluster of Dask that an earlier test has started leaves thresholds of its own behind.
    unset = {key: text for key, text in os.environ.items() if not key.startswith("MALLOC_")}
    command = [sys.executable, "-c", _ARRAYS_COME_AND_GO, case]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, env=unset)
    return float(ran.stdout)


def test_freed_arrays_go_back_to_the_system() -> None:
    assert kept_mb("as ever") > 20.0
    assert kept_mb("returned") < 5.0


def test_another_c_library_is_left_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ctypes.CDLL", lambda _: object())
    assert not return_freed_arrays()


def test_what_start_up_has_left_is_not_collected_again() -> None:
    try:
        freeze_gc_heap()
        assert gc.get_freeze_count() > 1000
    finally:
        gc.unfreeze()
