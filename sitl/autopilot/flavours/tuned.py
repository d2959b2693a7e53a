"""Parameters of autopilots that are set up as docs/vehicles.md says, which contracts count on."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, Literal

TUNED: Final[Mapping[Literal["px4", "ardupilot"], Mapping[str, float]]] = MappingProxyType(
    {
        "px4": MappingProxyType({"MPC_XY_P": 1.5, "MPC_JERK_AUTO": 15.0, "MPC_ACC_HOR": 5.0}),
        "ardupilot": MappingProxyType({"PSC_JERK_XY": 20.0, "WPNAV_ACCEL": 600.0}),
    }
)
