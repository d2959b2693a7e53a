"""A small field of stems for tests."""

from __future__ import annotations

import numpy as np

from gcs_tools.benchmark.obstacles import Obstacles
from gcs_tools.benchmark.scenes import Scene


def scene(*stems: tuple[float, float], length_m: float = 14.0) -> Scene:
    centres = np.array(stems)
    return Scene(
        "small", "leg 0", Obstacles.stems(centres, np.full(len(stems), 0.15)), length_m, 9.0
    )
