"""The flights that were recorded: which contract and mission they flew, and what was in the way.

The flights' own logs (MCAP) name contract and mission; where there is none, the legs are read off
the setpoints that the daemon sent.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from onboard.files.contract_file import (
    Contract,
    EnvironmentTerms,
    Requirements,
    SensorTerms,
    VehicleTerms,
)
from onboard.files.mission_file import Leg, Mission

EXCERPTS = Path(__file__).parent / "excerpts"

# North and east, least and largest.
BoxNed = tuple[float, float, float, float]


def contract(
    *,
    tracking_error_m: float,
    velocity_error_mps: tuple[float, float],
    reaction_time_s: float,
    setpoint_loss_timeout_s: float,
    setpoint_loss_run_on_m: float,
    separation_m: float,
) -> Contract:
    """Return the contract as it was flown: not the shipped one of today, which may differ."""
    return Contract(
        vehicle=VehicleTerms(
            roll_max_deg=15.0,
            pitch_max_deg=15.0,
            thrust_to_weight=2.0,
            cruise_speed_mps=2.8,
            radius_m=0.4,
            tracking_error_m=tracking_error_m,
            velocity_error_mps=velocity_error_mps,
            reaction_time_s=reaction_time_s,
            attitude_lag_s=0.27,
            setpoint_loss_timeout_s=setpoint_loss_timeout_s,
            setpoint_loss_run_on_m=setpoint_loss_run_on_m,
            recentring_speed_mps=0.0,
        ),
        # As flown: no way to rest was held, and a tracking error alone ended no flight.
        requirements=Requirements(stop=False, passive_safety=True),
        sensor=SensorTerms(
            detection_range_m=15.0,
            field_of_view_deg=90.0,
            frame_age_max_s=0.3,
            position_error_m=0.1,
        ),
        environment=EnvironmentTerms(
            obstacle_size_max_m=2.0,
            obstacle_size_min_m=0.0,
            obstacle_separation_min_m=separation_m,
        ),
    )


ARDUPILOT = contract(
    tracking_error_m=0.35,
    velocity_error_mps=(0.45, 0.5),
    reaction_time_s=0.25,
    setpoint_loss_timeout_s=0.5,
    setpoint_loss_run_on_m=3.4,
    separation_m=22.0,
)
PX4 = contract(
    tracking_error_m=0.8,
    velocity_error_mps=(0.75, 1.0),
    reaction_time_s=0.4,
    setpoint_loss_timeout_s=1.0,
    setpoint_loss_run_on_m=4.7,
    separation_m=31.0,
)


def mission(end_north_m: float) -> Mission:
    return Mission(
        start_ned_m=(0.0, 0.0),
        altitude_m=5.0,
        legs=(Leg(end_ned_m=(end_north_m, 0.0), target_half_width_m=12.0),),
    )


@dataclass(frozen=True)
class Flight:
    """One recorded flight.

    Attributes:
        name: of the recording and of its excerpt.
        contract, mission: as flown.
        window_s: what the excerpt holds, from the recording's first entry.
        body: whether the sensor reported in the body frame.
        placed: boxes that the tests put in the way where the recording does not say what was
            there: synthetic, where the flown phases show that something stood.
        gps_lost_s: when the excerpt's synthetic GPS is lost, from the recording's first entry.
    """

    name: str
    contract: Contract
    mission: Mission
    window_s: tuple[float, float]
    body: bool = False
    placed: tuple[BoxNed, ...] = field(default=())
    gps_lost_s: float | None = None

    @property
    def excerpt(self) -> Path:
        return EXCERPTS / f"{self.name}.tlog"


FLIGHTS = {
    flight.name: flight
    for flight in (
        Flight("px4_nominal", PX4, mission(122.0), (23.0, 50.0)),
        Flight("px4_nominal_tracking_1.2m", PX4, mission(122.0), (20.5, 47.0)),
        Flight("px4_false_second_commander", PX4, mission(122.0), (17.5, 25.0)),
        Flight("px4_gps_lost_contact", PX4, mission(89.0), (10.2, 26.9)),
        Flight(
            "px4_body_frame_heading_wander_contact",
            PX4,
            mission(122.0),
            (12.2, 28.2),
            body=True,
        ),
        Flight(
            "px4_handback_vertex_6383s",
            PX4,
            mission(89.0),
            (13.0, 37.8),
            placed=((25.36, -0.21, 26.16, 1.5),),
        ),
        Flight(
            "px4_refused_every_tick",
            PX4,
            mission(89.0),
            (13.0, 44.0),
            placed=((25.36, -0.21, 26.16, 1.5),),
        ),
        Flight("ardupilot_nominal", ARDUPILOT, mission(96.0), (12.5, 42.5)),
        Flight(
            "ardupilot_gps_lost_contact", ARDUPILOT, mission(72.0), (14.0, 36.0), gps_lost_s=20.6
        ),
        Flight("ardupilot_tail_wind_false_tilt_response", ARDUPILOT, mission(72.0), (9.0, 34.0)),
        Flight("ardupilot_second_commander_20hz", ARDUPILOT, mission(72.0), (14.0, 28.0)),
        Flight("ardupilot_wind_8mps", ARDUPILOT, mission(72.0), (10.2, 36.2)),
    )
}
