"""Vehicle, world and sensors together in virtual time."""

from __future__ import annotations

import math

from onboard.files.obstacle_field import ObstacleField
from onboard.files.truth_record import TruthRecord
from onboard.files.yaml_file import FileError
from sitl.autopilot.modes import Mode
from sitl.config import SitlConfig
from sitl.environment.formats.ros2_topics import Ros2Publisher
from sitl.environment.movers.movers import Movers
from sitl.environment.ranging_sensor import RangingSensor
from sitl.environment.sensor import ObstacleSensor
from sitl.environment.sensor_message import LinkMessage, ZenohMessage
from sitl.environment.truth_log import truth_record
from sitl.environment.world import World
from sitl.plant.pinned_error import PinnedError
from sitl.plant.truth import VehicleTruth
from sitl.vehicle.vehicle import SimulatedVehicle

_DEPARTED_MPS = 0.5
# A setpoint that is slower than this rests.
_RESTING_MPS = 0.05


class Scene:
    """Advance everything in lock step, for the live simulator and the virtual flight.

    Attributes:
        vehicle: plant and autopilot.
        world: clearance and collisions.
        movers: what moves around it.
        sensors: one for each that is configured.
        start_unix_s: time of day at simulation time zero.
    """

    def __init__(
        self,
        config: SitlConfig,
        field: ObstacleField,
        start_unix_s: float = 0.0,
        ticks_per_decision: int = 1,
    ) -> None:
        """Set everything up at time zero; ``config.seed`` seeds all random choices.

        For ``ticks_per_decision`` see `SimulatedVehicle`.

        Raises:
            ParameterError: a configured autopilot parameter does not exist or is out of range.
        """
        _check_rays(config, field)
        self.start_unix_s = start_unix_s
        self.vehicle = SimulatedVehicle(config, config.seed, start_unix_s, ticks_per_decision)
        body = config.multirotor
        self.world = World(field, body.radius_m, body.half_height_m)
        self.movers = Movers(config.movers, body.radius_m, config.seed)
        ideal = config.realism == "ideal"
        self.detectors = [
            ObstacleSensor(
                sensor, field, config.seed, start_unix_s, ideal=ideal, movers=self.movers.all
            )
            for sensor in config.sensors
            if sensor.publishes == "json"
        ]
        self._ranging = [
            RangingSensor(sensor, field, config.seed, start_unix_s, self.movers.all)
            for sensor in config.sensors
            if sensor.publishes != "json"
        ]
        tracking = config.tracking
        self._pinned = None
        if tracking.toward_obstacle:
            self._pinned = PinnedError(tracking.error_m or 0.0, tracking.seen_late_s)
        self._velocity_error_mps = tracking.velocity_error_mps
        self._kinematic = tracking.kinematic
        self._detections: list[ZenohMessage] = []
        self._pinned_s = 0.0
        self._departed = False
        self._due_s = 0.0  # when a sensor measures next
        self._observe()

    def advance(self, until_s: float) -> None:
        """Let time pass until ``until_s``, from decision to decision or measurement."""
        while self.vehicle.fly_on(until_s, self._due_s):
            if self._pinned is not None:
                self._pin(self._pinned)
            self._observe()

    @property
    def publishers(self) -> list[Ros2Publisher]:
        """Of the sensors that speak ROS 2."""
        return [one.publisher for one in self._ranging if one.publisher is not None]

    def take_detections(self) -> list[ZenohMessage]:
        """Return and clear what has left the sensors for Zenoh; the rest is on the links."""
        detections, self._detections = self._detections, []
        return detections

    def truth_record(self) -> TruthRecord:
        """Return the ground truth now."""
        return truth_record(self.vehicle.truth, self.world, self.start_unix_s, self.movers)

    def _pin(self, error: PinnedError) -> None:
        truth = self.vehicle.truth
        commander = self.vehicle.autopilot.commander
        # A vehicle that has yet to depart, or was handed back, gets no error: a service in standby
        # commands the position that the vehicle reports, so that the error would add up.
        if commander.mode is Mode.OFFBOARD:
            self._departed |= truth.ground_speed_mps > _DEPARTED_MPS
        else:
            self._departed = False
            error.forget(*self._own_error_m())
            self.vehicle.velocity_error_ned_mps = (0.0, 0.0)
            self.vehicle.pin_tracking_error(error.north_m, error.east_m)
        if self._departed and commander.airborne:
            toward = self._toward_what_is_near(truth)
            passed_s = truth.time_s - self._pinned_s
            estimated = self.vehicle.autopilot.estimator.error
            error.advance(
                toward,
                passed_s,
                self.vehicle.wanted_velocity_ned_mps,
                (estimated.north_m, estimated.east_m),
            )
            self.vehicle.pin_tracking_error(error.north_m, error.east_m)
            self.vehicle.velocity_error_ned_mps = self._velocity_error_ned_mps(toward)
        elif commander.mode is Mode.OFFBOARD and self._kinematic:
            error.forget(*self._own_error_m())
            self.vehicle.pin_tracking_error(error.north_m, error.east_m)
        self._pinned_s = truth.time_s

    def _toward_what_is_near(self, truth: VehicleTruth) -> tuple[float, float]:
        """Return the unit vector towards the nearest mover, or to the nearest obstacle without any.

        A vehicle at rest keeps the error that it has: at rest, it does not move.
        """
        if not self.movers.all:
            return self.world.toward_nearest(truth.position_ned_m)
        if math.hypot(*self.vehicle.wanted_velocity_ned_mps) < _RESTING_MPS:
            error = self._pinned
            assert error is not None  # noqa: S101  the caller has one
            length_m = math.hypot(error.north_m, error.east_m) or 1.0
            return error.north_m / length_m, error.east_m / length_m
        return self.movers.toward_nearest(truth.position_ned_m[:2])

    def _own_error_m(self) -> tuple[float, float]:
        """Return where the kinematic plant is without any further error: its estimate is exact."""
        error = self.vehicle.autopilot.estimator.error
        return (-error.north_m, -error.east_m) if self._kinematic else (0.0, 0.0)

    def _velocity_error_ned_mps(self, toward: tuple[float, float]) -> tuple[float, float]:
        """Return the velocity error: along the nose, and across it toward an obstacle."""
        along_mps, across_mps = self._velocity_error_mps
        yaw_rad = self.vehicle.truth.yaw_rad
        cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
        across_mps = math.copysign(across_mps, cosine * toward[1] - sine * toward[0])
        return cosine * along_mps - sine * across_mps, sine * along_mps + cosine * across_mps

    def _observe(self) -> None:
        truth, estimate = self.vehicle.truth, self.vehicle.estimate
        self.world.observe(truth.position_ned_m, truth.tilt_rad)
        self.movers.advance(
            truth.time_s,
            truth.position_ned_m[:2],
            truth.velocity_ned_mps[:2],
            airborne=self.vehicle.autopilot.commander.airborne,
            lowest_down_m=truth.position_ned_m[2] + self.world.rise_m(truth.tilt_rad),
        )
        for detector in self.detectors:
            for payload in detector.sense(truth.time_s, truth, estimate):
                self._detections.append(ZenohMessage(detector.config.source, payload))
        for ranging in self._ranging:
            for message in ranging.sense(truth.time_s, truth):
                if isinstance(message, LinkMessage):
                    self.vehicle.autopilot.send_ranges(message.message)
                else:
                    self._detections.append(message)
        due_s = [one.due_s for one in self.detectors] + [one.due_s for one in self._ranging]
        self._due_s = min(due_s, default=math.inf)


def _check_rays(config: SitlConfig, field: ObstacleField) -> None:
    """Refuse sensors of rays among obstacles of limited height, which they do not meet so."""
    if field.down_m is None:
        return
    for sensor in config.sensors:
        if not sensor.is_ideal:
            raise FileError(
                f"sensors: {sensor.source} is a {sensor.publishes} of rays, which take every "
                "obstacle for a pillar, but the field states down_m [m] (expected publishes: json, "
                "without scanner)"
            )
