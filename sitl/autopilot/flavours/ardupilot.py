"""The ArduPilot Copter flavour: modes, streams, and how far it is from an ideal autopilot.

ArduPilot sends no messages but heartbeats until it is asked for them.  Behaviour is that of
ArduCopter 4.6 to 4.7, as measured in its own simulator.
"""

from __future__ import annotations

import math
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.decisions import Verdict
from sitl.autopilot.flavours.ardupilot_commander import MISSION_FIRST_ITEM, CopterCommander
from sitl.autopilot.flavours.ardupilot_parameters import GAINS, PARAMETERS, flight_settings
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.parameters import ParameterSpec, ParameterStore, ideal_gains
from sitl.autopilot.modes import Mode
from sitl.autopilot.realism import Realism
from sitl.autopilot.settings import FlightSettings
from sitl.config import HomeConfig
from sitl.plant.estimator import Estimator, EstimatorProfile
from sitl.plant.truth import VehicleTruth

_MODES = {
    Mode.STABILIZED: 0,
    Mode.ACRO: 1,
    Mode.ALTCTL: 2,
    Mode.MISSION: 3,
    Mode.OFFBOARD: 4,
    Mode.POSCTL: 5,
    Mode.RTL: 6,
    Mode.LAND: 9,
    Mode.HOLD: 17,  # BRAKE
}
_MODE_OF_NUMBER = {number: mode for mode, number in _MODES.items()}


class Copter(Flavour):
    """ArduPilot Copter's names and numbers."""

    autopilot = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    version = 4 << 24 | 6 << 16 | 255  # 4.6.0, official release
    capabilities = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_C_CAST
    default_rates_hz = MappingProxyType({mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0})
    texts_need_ground_station = False
    integers_bytewise = False
    mission_first_item = MISSION_FIRST_ITEM
    take_off_above_sea = False
    modes = tuple(_MODES)
    describes_itself = False
    unknown_interval = Verdict.FAILED
    partial_missions = True
    target_type_mask = (
        mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
        | mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
    )
    field = Realism(
        estimator=EstimatorProfile(
            position_m=0.06,
            height_m=0.05,
            velocity_mps=0.04,
            climb_mps=0.01,
            heading_rad=math.radians(1.1),
            drift_mps2=0.03,
            drift_max_mps=0.30,
            dead_reckoning_s=7.9,
            aiding_stops_s=15.0,
        ),
        jerk_share=0.3,  # ATC_INPUT_TC smooths the rest away
        drag_share=0.0,
        trim_time_s=2.0,  # PSC_VELXY_P / PSC_VELXY_I
        reports_lost_position_s=15.0,
        levels_when_lost=True,
    )
    ideal = Realism(parameters=ideal_gains(GAINS))

    def parameter_specs(self, system_id: int) -> tuple[ParameterSpec, ...]:
        """Return all parameters with their defaults."""
        own = ParameterSpec("SYSID_THISMAV", system_id, 1, 255, "system id", read_only=True)
        return (*PARAMETERS, own)

    def settings(self, parameters: ParameterStore) -> FlightSettings:
        """Return what the parameters mean."""
        return flight_settings(parameters)

    def commander(
        self,
        settings: FlightSettings,
        truth: VehicleTruth,
        origin: HomeConfig,
        estimator: Estimator,
    ) -> CopterCommander:
        """Return this autopilot's decisions."""
        return CopterCommander(settings, truth, origin, estimator)

    def custom_mode(self, mode: Mode) -> int:
        """Return HEARTBEAT.custom_mode; a take-off is part of GUIDED."""
        return _MODES[Mode.OFFBOARD if mode is Mode.TAKEOFF else mode]

    def mode_of_command(self, main: int, _: int) -> Mode | None:
        """Return the mode of MAV_CMD_DO_SET_MODE's second parameter; sub modes do not exist."""
        return _MODE_OF_NUMBER.get(main)

    def mode_of_custom(self, custom_mode: int) -> Mode | None:
        """Return the mode of SET_MODE.custom_mode."""
        return _MODE_OF_NUMBER.get(custom_mode)
