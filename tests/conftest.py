import os
from collections.abc import Iterator

import pytest
from hypothesis import Phase, settings

# A loaded machine must not fail a test: only the benchmarks measure time.
settings.register_profile("clearway", deadline=None)
# Shrinking a failure that detects a mutant would only take time.
settings.register_profile(
    "mutation", deadline=None, max_examples=12, phases=(Phase.explicit, Phase.generate)
)
settings.load_profile("clearway")


@pytest.fixture(autouse=True, scope="session")
def _ordinary_priority() -> Iterator[None]:
    """Refuse this process real-time priority: else all later tests would run before all else.

    What a test starts as a process of its own may take it.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "sched_setscheduler", _refuse)
        yield


def _refuse(*_: object) -> None:
    raise PermissionError
