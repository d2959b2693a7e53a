"""The PX4 flavour: modes, streams, and how far it is from an ideal autopilot.

Behaviour is that of PX4 1.15 to 1.16, as measured in its own simulator.
"""

from __future__ import annotations

import math
from types import MappingProxyType

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl.autopilot.decisions import Verdict
from sitl.autopilot.flavours.flavour import Flavour
from sitl.autopilot.flavours.parameters import ParameterSpec, ParameterStore, ideal_gains
from sitl.autopilot.flavours.px4_commander import MISSION_FIRST_ITEM, Px4Commander
from sitl.autopilot.flavours.px4_parameters import GAINS, PARAMETERS, flight_settings
from sitl.autopilot.flavours.standard_modes import CURRENT_MODE_ID
from sitl.autopilot.modes import Mode
from sitl.autopilot.realism import Realism
from sitl.autopilot.settings import FlightSettings
from sitl.config import HomeConfig
from sitl.plant.estimator import Estimator, EstimatorProfile
from sitl.plant.truth import VehicleTruth

_MODES = {
    Mode.MANUAL: (1, 0),
    Mode.ALTCTL: (2, 0),
    Mode.POSCTL: (3, 0),
    Mode.TAKEOFF: (4, 2),
    Mode.HOLD: (4, 3),
    Mode.MISSION: (4, 4),
    Mode.RTL: (4, 5),
    Mode.LAND: (4, 6),
    Mode.ACRO: (5, 0),
    Mode.OFFBOARD: (6, 0),
    Mode.STABILIZED: (7, 0),
}
_MODE_OF_CODE = {code: mode for mode, code in _MODES.items()}


class Px4(Flavour):
    """PX4's names and numbers."""

    autopilot = mavlink.MAV_AUTOPILOT_PX4
    version = 1 << 24 | 15 << 16 | 255  # 1.15.0, official release
    capabilities = mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
    # PX4's onboard link, with rates between its own; others are on request only.
    default_rates_hz = MappingProxyType(
        {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: 50.0,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 50.0,
            mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED: 10.0,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 5.0,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: 4.0,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 2.0,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 2.0,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 1.0,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
            mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 1.0,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: 0.5,
        }
    )
    texts_need_ground_station = True
    integers_bytewise = True
    mission_first_item = MISSION_FIRST_ITEM
    take_off_above_sea = True
    modes = tuple(_MODES)
    describes_itself = True
    unknown_interval = Verdict.ACCEPTED
    partial_missions = False
    field = Realism(
        estimator=EstimatorProfile(
            position_m=0.45,
            height_m=0.30,
            velocity_mps=0.60,
            climb_mps=0.20,
            heading_rad=math.radians(3.5),
            drift_mps2=0.30,
            drift_max_mps=1.0,
            dead_reckoning_s=5.7,
            aiding_stops_s=7.7,
        ),
        jerk_share=0.0,
        drag_share=0.0,
        trim_time_s=4.5,  # MPC_XY_VEL_P_ACC / MPC_XY_VEL_I_ACC
        rate_per_s=15.0,
        rates_hz=MappingProxyType(
            {
                mavlink.MAVLINK_MSG_ID_ATTITUDE: 100.0,
                mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 30.0,
                mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 8.0,
                mavlink.MAVLINK_MSG_ID_SYS_STATUS: 5.0,
                mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 5.0,
                mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: 0.5,
                CURRENT_MODE_ID: 0.5,
            }
        ),
        echoes_controller=True,
        rest_is_constant_position=True,
        timesync_misaddressed=True,
        legacy_requests=False,
        reports_lost_position_s=math.inf,
        levels_when_lost=True,
        fix_when_lost=mavlink.GPS_FIX_TYPE_NO_GPS,
        drops_gps_after_s=7.3,
    )
    ideal = Realism(parameters=ideal_gains(GAINS))

    def parameter_specs(self, system_id: int) -> tuple[ParameterSpec, ...]:
        """Return all parameters with their defaults."""
        own = ParameterSpec("MAV_SYS_ID", system_id, 1, 250, "system id", read_only=True)
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
    ) -> Px4Commander:
        """Return this autopilot's decisions."""
        return Px4Commander(settings, truth, origin, estimator)

    def custom_mode(self, mode: Mode) -> int:
        """Return HEARTBEAT.custom_mode: main mode in the third byte, sub mode in the fourth."""
        main, sub = _MODES[mode]
        return main << 16 | sub << 24

    def mode_of_command(self, main: int, sub: int) -> Mode | None:
        """Return the mode of MAV_CMD_DO_SET_MODE; sub modes matter in AUTO only."""
        return _MODE_OF_CODE.get((main, sub if main == 4 else 0))

    def mode_of_custom(self, custom_mode: int) -> Mode | None:
        """Return the mode of SET_MODE.custom_mode."""
        return self.mode_of_command(custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF)
