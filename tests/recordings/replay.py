"""Replays what a real autopilot said through the service, without I/O.

The recorded vehicle followed the set-points that were sent to it then, not those of today's
service.  So the replayed service takes the recorded ones as its own reference: its monitors compare
the vehicle with what it was really asked for, while phases, plans and answers are today's.

    python -m tests.recordings.replay FILE.tlog...

replays whole recordings and prints, for each, what the service would have said.
"""

from __future__ import annotations

import argparse
import bisect
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

from pymavlink.dialects.v20 import ardupilotmega as mavlink

import onboard.autonomy
from onboard.autonomy import Autonomy
from onboard.contract.assessment import TICK_S
from onboard.events import Event
from onboard.files.contract_file import Contract
from onboard.files.mission_file import Mission
from onboard.geometry.frames import Vector
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import Phase
from onboard.guidance.reference import Reference
from onboard.guidance.situation import Situation
from onboard.mavlink.transmitter import COMPONENT_ID
from onboard.motion.trajectory import State
from onboard.vehicle_state import Setpoint
from tests.recordings.flights import ARDUPILOT, FLIGHTS, PX4, BoxNed, Flight, mission
from tests.recordings.sightings import (
    Sighting,
    Sightings,
    hulls_of_log,
    read_hulls,
)
from tests.recordings.synthetic import with_ardupilot_gps
from tests.recordings.tlog import Decoder, Entry, read_tlog

# A set-point older than this was the last before the stream paused.
_SETPOINT_AGE_MAX_S = 0.1
_FRAME_PERIOD_S = 0.05
# How far off each face of a box may be, as the recorded sensor declared.
_UNCERTAINTY_M = 0.1


@dataclass(frozen=True)
class Sent:
    """A set-point as the recorded daemon sent it."""

    time_s: float
    setpoint: Setpoint


@dataclass
class Recording:
    """What crossed a link, on the clock of the replay, whose zero is the first entry.

    Attributes:
        epoch_unix_s: Unix time of the first entry.
        duration_s: until the last one.
        received: what reached the daemon, and when.
        sent: the set-points that it sent.
        texts: what it said, and when.
        heard: what was received, decoded.
    """

    epoch_unix_s: float
    duration_s: float
    received: list[tuple[float, bytes]] = field(default_factory=list)
    sent: list[Sent] = field(default_factory=list)
    texts: list[tuple[float, str]] = field(default_factory=list)
    heard: list[tuple[float, Any]] = field(default_factory=list)
    _poses: list[list[tuple[float, ...]]] = field(default_factory=list)

    @classmethod
    def of(cls, entries: Iterable[Entry]) -> Recording:
        decoder, recording = Decoder(), None
        for entry in entries:
            recording = recording or cls(entry.time_unix_s, 0.0)
            time_s = entry.time_unix_s - recording.epoch_unix_s
            recording.duration_s = max(recording.duration_s, time_s)
            message = decoder.decode(entry)
            if entry.sender[1] == COMPONENT_ID:
                recording._take_sent(time_s, message)
            else:
                recording.received.append((time_s, entry.frame))
                if message is not None:
                    recording.heard.append((time_s, message))
        if recording is None:
            raise ValueError("the recording is empty")
        return recording

    def _take_sent(self, time_s: float, message: Any) -> None:
        if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            setpoint = Setpoint(
                (message.x, message.y, message.z),
                (message.vx, message.vy, message.vz),
                (message.afx, message.afy, message.afz),
                message.yaw,
            )
            self.sent.append(Sent(time_s, setpoint))
        elif message.get_type() == "STATUSTEXT":
            self.texts.append((time_s, message.text))

    def changed(self, kind: str, change: Callable[[float, Any], None]) -> Recording:
        """Return the recording as if the autopilot had said something else.

        Args:
            kind: of the messages to change.
            change: takes the time and a message of that kind, and changes its fields.
        """
        decoder, codecs = Decoder(), dict[tuple[int, int], Any]()
        changed = Recording(self.epoch_unix_s, self.duration_s, sent=self.sent, texts=self.texts)
        for time_s, frame in self.received:
            entry = Entry(time_s, frame)
            message = decoder.decode(entry)
            if message is not None and message.get_type() == kind:
                change(time_s, message)
                codec = codecs.setdefault(entry.sender, mavlink.MAVLink(None, *entry.sender))
                frame = bytes(message.pack(codec))  # noqa: PLW2901  the same, changed
            changed.received.append((time_s, frame))
            if message is not None:
                changed.heard.append((time_s, message))
        return changed

    def messages(self, kind: str) -> Iterator[tuple[float, Any]]:
        """Yield the received messages of one kind, with their times."""
        return ((time_s, m) for time_s, m in self.heard if m.get_type() == kind)

    def first(self, kind: str, **fields: Any) -> float:
        """Return when a message of a kind first had these values; raise if it never had."""
        for time_s, message in self.messages(kind):
            if all(getattr(message, name) == value for name, value in fields.items()):
                return time_s
        raise LookupError(f"no {kind} with {fields}")

    def first_text(self, words: str) -> float:
        """Return when the recorded daemon first said something."""
        return next(time_s for time_s, text in self.texts if words in text)

    def pose_at(self, time_s: float) -> tuple[float, float, float]:
        """Return north, east and heading as the autopilot estimated them at a time."""
        if not self._poses:
            self._poses = [
                [(t, m.x, m.y) for t, m in self.messages("LOCAL_POSITION_NED")],
                [(t, m.yaw) for t, m in self.messages("ATTITUDE")],
            ]
        (north_m, east_m), (yaw_rad,) = (_interpolated(rows, time_s) for rows in self._poses)
        return north_m, east_m, yaw_rad

    def setpoint_at(self, time_s: float) -> Setpoint | None:
        """Return what the vehicle was asked for at a time; None where nothing was sent."""
        after = bisect.bisect_right(self.sent, time_s, key=lambda sent: sent.time_s)
        if after == 0 or time_s - self.sent[after - 1].time_s > _SETPOINT_AGE_MAX_S:
            return None
        before = self.sent[after - 1]
        if after == len(self.sent) or self.sent[after].time_s - before.time_s > _SETPOINT_AGE_MAX_S:
            return before.setpoint
        following = self.sent[after]
        share = (time_s - before.time_s) / (following.time_s - before.time_s)
        one, other = before.setpoint, following.setpoint
        return Setpoint(
            _between(one.position_ned_m, other.position_ned_m, share),
            _between(one.velocity_ned_mps, other.velocity_ned_mps, share),
            _between(one.acceleration_ned_mps2, other.acceleration_ned_mps2, share),
            one.yaw_ned_rad,
        )

    def avoiding(self, time_s: float) -> bool:
        """Tell whether the recorded daemon was flying an avoidance."""
        latest = ""
        for said_s, text in self.texts:
            if said_s > time_s:
                break
            if any(word in text for word in ("avoiding", "cruise (", "standby (", "holding")):
                latest = text
        return "avoiding" in latest


def _between(one: Vector, other: Vector, share: float) -> Vector:
    x, y, z = (a + share * (b - a) for a, b in zip(one, other, strict=True))
    return x, y, z


def _interpolated(rows: list[tuple[float, ...]], time_s: float) -> tuple[float, ...]:
    after = bisect.bisect_right(rows, time_s, key=lambda row: row[0])
    if after in (0, len(rows)):
        return rows[min(after, len(rows) - 1)][1:]
    before, following = rows[after - 1], rows[after]
    share = (time_s - before[0]) / (following[0] - before[0])
    return tuple(a + share * (b - a) for a, b in zip(before[1:], following[1:], strict=True))


class FollowingReference(Reference):
    """A reference that is what the recorded daemon sent, wherever it sent anything."""

    def __init__(self, situation: Situation, recording: Recording) -> None:
        super().__init__()
        self._situation, self._recording = situation, recording

    def sample(self, time_s: float) -> State | None:
        own = super().sample(time_s)
        asked = self._recording.setpoint_at(time_s)
        if own is None or asked is None:
            return own
        leg = self._situation.leg
        return State(
            leg.position_leg(asked.position_ned_m),
            leg.vector_leg(asked.velocity_ned_mps),
            leg.vector_leg(asked.acceleration_ned_mps2),
        )


class FollowingNavigator(Navigator):
    """A navigator that follows a recording."""

    recording: Recording
    now_s: float = 0.0

    def follow(self, recording: Recording) -> None:
        self.recording = recording
        self.situation.reference = FollowingReference(self.situation, recording)

    @property
    def cruising_freely(self) -> bool:
        return super().cruising_freely and not self.recording.avoiding(self.now_s)


@dataclass
class Replayed:
    """What the service said of a recording, and what it sent.

    Attributes:
        events: all, in order.
        phases: the phase of each tick, with its time.
        plan_times_s: how long each plan lasts.
    """

    events: list[Event] = field(default_factory=list)
    phases: list[tuple[float, Phase]] = field(default_factory=list)
    plan_times_s: list[float] = field(default_factory=list)

    def violations(self, *assumptions: str) -> list[Event]:
        """Return the violations of some assumptions; of all, if none is named."""
        return [
            event
            for event in self.events
            if event.name == "violation"
            and (not assumptions or event.data["assumption"] in assumptions)
        ]

    def named(self, name: str) -> list[Event]:
        return [event for event in self.events if event.name == name]

    def first_s(self, phase: Phase, *, after_s: float = -math.inf) -> float:
        """Return when a phase was first entered after a time; infinite if it never was."""
        return next((t for t, flown in self.phases if flown is phase and t > after_s), math.inf)


def replay(
    recording: Recording,
    contract: Contract,
    mission_flown: Mission,
    *,
    sightings: Sightings | None = None,
    placed: tuple[BoxNed, ...] = (),
    body: bool = False,
    following: bool = True,
) -> Replayed:
    """Run the service over a recording.

    Args:
        recording: what the autopilot said, and what it was asked for.
        contract, mission_flown: as they were in the flight.
        sightings: what the sensor measured, if that is known.
        placed: boxes that are measured exactly, at any time.
        body: report in the body frame.
        following: take the recorded set-points for the service's own.
    """
    with mock.patch.object(
        onboard.autonomy, "Navigator", FollowingNavigator if following else Navigator
    ):
        autonomy = Autonomy(contract, mission_flown, epoch_unix_s=recording.epoch_unix_s)
    navigator = autonomy.navigator
    if isinstance(navigator, FollowingNavigator):
        navigator.follow(recording)
    sensor = _Sensor(recording, sightings, placed, body=body)
    replayed, at = Replayed(), 0
    for tick in range(1, math.ceil(recording.duration_s / TICK_S) + 1):
        now_s = tick * TICK_S
        while at < len(recording.received) and recording.received[at][0] <= now_s:
            arrived_s, frame = recording.received[at]
            autonomy.receive_mavlink(frame, arrived_s)
            at += 1
        for payload in sensor.frames(now_s):
            autonomy.receive_detection(payload, now_s)
        if isinstance(navigator, FollowingNavigator):
            navigator.now_s = now_s
        autonomy.tick(now_s)
        autonomy.mavlink_to_send()
        replayed.events += autonomy.events()
        replayed.phases.append((now_s, navigator.phase))
        replayed.plan_times_s += [
            step.plan.trajectory.end_s - step.plan.trajectory.start_s
            for step in navigator.take_planned()
        ]
    return replayed


class _Sensor:
    """Frames at 20 Hz, of what was measured a frame period ago."""

    def __init__(
        self,
        recording: Recording,
        sightings: Sightings | None,
        placed: tuple[BoxNed, ...],
        *,
        body: bool,
    ) -> None:
        self._recording = recording
        self._sightings = sightings
        self._placed = [
            Sighting(
                f"placed{number}",
                ((north_0 + north_1) / 2.0, (east_0 + east_1) / 2.0),
                (north_1 - north_0, east_1 - east_0),
            )
            for number, (north_0, east_0, north_1, east_1) in enumerate(placed)
        ]
        self._body = body
        self._sequence = 0

    def frames(self, now_s: float) -> Iterator[bytes]:
        """Yield the frame that arrives at a time, if one does."""
        if now_s < (self._sequence + 1) * _FRAME_PERIOD_S:
            return
        self._sequence += 1
        stamp_s = self._sequence * _FRAME_PERIOD_S - 0.03
        north_m, _, _ = self._recording.pose_at(stamp_s)
        seen = []
        measured = (
            self._sightings.at(self._recording.epoch_unix_s + stamp_s) if self._sightings else []
        )
        for sighting in (*measured, *self._placed):
            ahead_m = sighting.center_ned_m[0] - sighting.size_m[0] / 2.0 - north_m
            if -sighting.size_m[0] < ahead_m < 15.0:
                seen.append(self._detection(sighting, stamp_s))
        yield json.dumps(
            {
                "version": 1,
                "source": "front",
                "sequence": self._sequence,
                "stamp_unix_s": self._recording.epoch_unix_s + stamp_s,
                "frame": "body_frd" if self._body else "local_ned",
                "range_m": 15.0,
                "field_of_view_deg": 90.0,
                "obstacles": seen,
            }
        ).encode()

    def _detection(self, sighting: Sighting, stamp_s: float) -> dict[str, Any]:
        center_m, yaw_rad = sighting.center_ned_m, 0.0
        if self._body:
            north_m, east_m, yaw_rad = self._recording.pose_at(stamp_s)
            north_m, east_m = center_m[0] - north_m, center_m[1] - east_m
            cosine, sine = math.cos(yaw_rad), math.sin(yaw_rad)
            center_m = (cosine * north_m + sine * east_m, cosine * east_m - sine * north_m)
        return {
            "id": sighting.track_id,
            "center_m": center_m,
            "size_m": sighting.size_m,
            "yaw_deg": -math.degrees(yaw_rad),
            "uncertainty_m": _UNCERTAINTY_M,
        }


def replay_excerpt(name: str, *, following: bool = True) -> tuple[Recording, Replayed]:
    """Replay one of the tests' excerpts as its flight was flown."""
    return replay_file(FLIGHTS[name].excerpt, following=following)


def replay_file(path: Path, *, following: bool = True) -> tuple[Recording, Replayed]:
    """Replay a ``.tlog``; the log, or the hulls, beside it tell what the sensor saw."""
    entries = list(read_tlog(path))
    flight = FLIGHTS.get(path.stem)
    if entries:
        lost_s = flight.gps_lost_s if flight else None
        entries = with_ardupilot_gps(entries, entries[0].time_unix_s, lost_s)
    recording = Recording.of(entries)
    flight = flight or _unknown_flight(path, recording)
    return recording, replay_flight(flight, recording, _sightings_beside(path), following=following)


def replay_flight(
    flight: Flight,
    recording: Recording,
    sightings: Sightings | None = None,
    *,
    following: bool = True,
) -> Replayed:
    """Replay a recording as a flight was flown."""
    return replay(
        recording,
        flight.contract,
        flight.mission,
        sightings=sightings,
        placed=flight.placed,
        body=flight.body,
        following=following,
    )


def _sightings_beside(path: Path) -> Sightings | None:
    hulls, log = (path.with_name(path.stem + suffix) for suffix in (".hulls.json", ".mcap"))
    if hulls.exists():
        return Sightings(read_hulls(hulls))
    return Sightings(hulls_of_log(log)) if log.exists() else None


def _unknown_flight(path: Path, recording: Recording) -> Flight:
    """Return what a recording that is not in the catalogue seems to have flown: straight north."""
    pilots = [m.autopilot for _, m in recording.messages("HEARTBEAT") if m.get_srcComponent() == 1]
    terms = ARDUPILOT if mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA in pilots else PX4
    end_m = max((sent.setpoint.position_ned_m[0] for sent in recording.sent), default=0.0)
    return Flight(path.stem, terms, mission(max(end_m, 10.0)), (0.0, recording.duration_s))


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="a .tlog")
    parser.add_argument("--all", action="store_true", help="print notices and phases, too")
    options = parser.parse_args(arguments)
    for path in options.files:
        try:
            recording, replayed = replay_file(path)
        except (OSError, ValueError) as error:
            print(f"{path}: {error}", file=sys.stderr)
            return 2
        shown = [e for e in replayed.events if options.all or e.name in _SHOWN]
        longest_s = max(replayed.plan_times_s, default=0.0)
        print(
            f"{path.name}: {recording.duration_s:.1f} s, {len(replayed.violations())} violations, "
            f"longest plan {longest_s:.1f} s"
        )
        for event in shown:
            print(f"  {event.time_s:7.2f} s  {event.name:<10} {event.text}")
    return 0


_SHOWN = ("violation", "suspicion", "phase", "refused", "adapted", "handed_over")


if __name__ == "__main__":
    sys.exit(main())
