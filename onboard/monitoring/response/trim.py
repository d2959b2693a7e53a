"""The tilt that no acceleration of the vehicle explains: it balances a steady wind.

The horizontal acceleration that the attitude gives in level flight, g tan, less that of the
velocity estimate, low-pass filtered.  It is kept in NED, since a vehicle that turns keeps its wind.
"""

from __future__ import annotations

import math
from typing import Final

from onboard.contract.agility import GRAVITY_MPS2
from onboard.vehicle_state import Pose

Horizontal = tuple[float, float]

# Time constant, and how long it must have learnt before its value is used: two of them leave 13 %
# of what has changed since.
TRIM_TIME_S: Final = 1.0
LEARNING_TIME_S: Final = 2.0
# Poses farther apart than this, or accelerations beyond this between two of them, are a gap or a
# reset of the estimator, not motion.
GAP_MAX_S: Final = 0.2
ACCELERATION_MAX_MPS2: Final = 20.0


def tilt_acceleration(pose: Pose) -> Horizontal:
    """Return the acceleration, north and east in m/s², that an attitude gives in level flight."""
    forward_mps2 = -GRAVITY_MPS2 * math.tan(pose.pitch_rad)
    right_mps2 = GRAVITY_MPS2 * math.tan(pose.roll_rad)
    cosine, sine = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
    return cosine * forward_mps2 - sine * right_mps2, sine * forward_mps2 + cosine * right_mps2


class TrimEstimator:
    """Learns the trim from poses.

    Attributes:
        trim_mps2: tilt as acceleration, north and east, that balances the drag of late.
        velocity_mps: over the ground, averaged like the trim.
        learnt_s: time over which it has learnt.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Begin anew, as on the ground, whose slope is not wind."""
        self.trim_mps2: Horizontal = (0.0, 0.0)
        self.velocity_mps: Horizontal = (0.0, 0.0)
        self.learnt_s = 0.0
        self._previous: Pose | None = None

    @property
    def ready(self) -> bool:
        """Whether it has learnt for long enough."""
        return self.learnt_s >= LEARNING_TIME_S

    def learn(self, pose: Pose) -> None:
        """Take the next pose of steady flight; after a gap, `skip` it first."""
        previous, self._previous = self._previous, pose
        if previous is None:
            return
        step_s = pose.time_s - previous.time_s
        if not 0.0 < step_s <= GAP_MAX_S:
            return
        velocity_mps = pose.velocity_ned_mps[:2]
        gained_mps2 = [
            (now - before) / step_s
            for now, before in zip(velocity_mps, previous.velocity_ned_mps[:2], strict=True)
        ]
        if math.hypot(*gained_mps2) > ACCELERATION_MAX_MPS2:
            return
        self.learnt_s += step_s
        # A plain mean at first, so that the first pose weighs no more than any other.
        share = step_s / min(self.learnt_s, TRIM_TIME_S)
        tilt_mps2 = tilt_acceleration(pose)
        north_mps2, east_mps2 = tilt_mps2[0] - gained_mps2[0], tilt_mps2[1] - gained_mps2[1]
        self.trim_mps2 = _towards(self.trim_mps2, (north_mps2, east_mps2), share)
        self.velocity_mps = _towards(self.velocity_mps, (velocity_mps[0], velocity_mps[1]), share)

    def skip(self) -> None:
        """Learn nothing from the motion up to the next pose."""
        self._previous = None


def _towards(value: Horizontal, sample: Horizontal, share: float) -> Horizontal:
    return value[0] + share * (sample[0] - value[0]), value[1] + share * (sample[1] - value[1])
