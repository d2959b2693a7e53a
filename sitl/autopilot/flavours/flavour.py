"""What makes an autopilot PX4 or ArduPilot to its peers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

from sitl.autopilot.commander import Commander
from sitl.autopilot.decisions import Verdict
from sitl.autopilot.flavours.parameters import ParameterSpec, ParameterStore
from sitl.autopilot.modes import Mode
from sitl.autopilot.realism import Realism
from sitl.autopilot.settings import FlightSettings
from sitl.config import HomeConfig
from sitl.plant.estimator import Estimator
from sitl.plant.truth import VehicleTruth


class Flavour(ABC):
    """One autopilot's names, numbers and behaviour.

    Attributes:
        autopilot: MAV_AUTOPILOT.
        version: AUTOPILOT_VERSION.flight_sw_version.
        capabilities: MAV_PROTOCOL_CAPABILITY bits beyond those of every flavour.
        default_rates_hz: messages that a link gets without a request.
        texts_need_ground_station: whether STATUSTEXT goes only to links with a ground station.
        integers_bytewise: whether integer parameters are copied into the float field bit by bit.
        mission_first_item: number of the first item flown.
        take_off_above_sea: whether MAV_CMD_NAV_TAKEOFF gives altitude above mean sea level.
        field, ideal: its behaviour as measured, and an ideal one.
        modes: what AVAILABLE_MODES lists.
        target_type_mask: POSITION_TARGET_LOCAL_NED.type_mask.
        describes_itself: whether it answers requests for COMPONENT_METADATA and PROTOCOL_VERSION.
        unknown_interval: result of asking for the interval of a message that is not sent.
        partial_missions: whether a part of the mission can be written.
    """

    autopilot: ClassVar[int]
    version: ClassVar[int]
    capabilities: ClassVar[int]
    default_rates_hz: ClassVar[Mapping[int, float]]
    texts_need_ground_station: ClassVar[bool]
    integers_bytewise: ClassVar[bool]
    mission_first_item: ClassVar[int]
    take_off_above_sea: ClassVar[bool]
    field: ClassVar[Realism]
    ideal: ClassVar[Realism]
    modes: ClassVar[tuple[Mode, ...]]
    target_type_mask: ClassVar[int] = 0
    describes_itself: ClassVar[bool]
    unknown_interval: ClassVar[Verdict]
    partial_missions: ClassVar[bool]

    @abstractmethod
    def parameter_specs(self, system_id: int) -> tuple[ParameterSpec, ...]:
        """Return all parameters with their defaults."""

    @abstractmethod
    def settings(self, parameters: ParameterStore) -> FlightSettings:
        """Return what the parameters mean."""

    @abstractmethod
    def commander(
        self,
        settings: FlightSettings,
        truth: VehicleTruth,
        origin: HomeConfig,
        estimator: Estimator,
    ) -> Commander:
        """Return this autopilot's decisions."""

    @abstractmethod
    def custom_mode(self, mode: Mode) -> int:
        """Return HEARTBEAT.custom_mode."""

    @abstractmethod
    def mode_of_command(self, main: int, sub: int, /) -> Mode | None:
        """Return the mode of MAV_CMD_DO_SET_MODE's second and third parameter."""

    @abstractmethod
    def mode_of_custom(self, custom_mode: int) -> Mode | None:
        """Return the mode of SET_MODE.custom_mode."""
