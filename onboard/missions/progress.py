"""How far a mission has been flown, remembered over a restart, and how it goes on from there.

A flight that was left goes on by the operator's word only, and only where mission, contract and
home are what they were.  What goes on is a mission like any other: it begins where the vehicle is,
leads to the place where the flight was left if that lies elsewhere, and passes every check of a
first departure; nothing that was seen before counts.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Final

from pydantic import BaseModel, ConfigDict, Field

from onboard.events import Event, EventName, Severity
from onboard.files.mission_file import LEG_LENGTH_MIN_M, Leg, Mission, Point
from onboard.geometry.local_frame import Autopilot, GeographicPoint, LocalFrame
from onboard.guidance.departure import START_TOLERANCE_M, Refusal, RefusalKind
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import FlightState, Phase
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.vehicle_state import Pose

# The origin of the local frame is where the estimator got its first position: on the same spot, a
# GNSS receiver finds it again to within this much.
ORIGIN_MOVED_MAX_M: Final = 3.0
# How often the place is noted.
NOTE_PERIOD_S: Final = 0.5
_E7: Final = 1e-7
_FRAMES: Final[dict[str, Autopilot]] = {"px4": "px4", "ardupilot": "ardupilot"}


class SavedProgress(BaseModel):
    """How far a mission was flown, as it is saved; the default: none was left.

    Attributes:
        mission: identity of the mission.
        contract_sha256: of the contract as declared.
        origin_e7: latitude and longitude of the local origin, 1e-7 degrees; None: not known.
        leg, legs: the leg that was flown, counted from 1, and how many there are.
        place_ned_m: where, north and east.
        time_unix_s: when.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    mission: str = ""
    contract_sha256: str = ""
    origin_e7: Annotated[tuple[int, int], Field(strict=False)] | None = None
    leg: Annotated[int, Field(ge=0)] = 0
    legs: Annotated[int, Field(ge=0)] = 0
    place_ned_m: Point = (0.0, 0.0)
    time_unix_s: float = 0.0

    @property
    def unfinished(self) -> bool:
        """Whether a flight was left."""
        return self.leg > 0

    def __str__(self) -> str:
        north_m, east_m = self.place_ned_m
        return f"leg {self.leg} of {self.legs}, {north_m:.0f} m north, {east_m:.0f} m east"


@dataclass(frozen=True)
class _Continuation:
    """A mission that goes on with another one.

    Attributes:
        mission: that is flown.
        stated: the mission that it goes on with.
        name: identity of that one.
        ahead: how many legs lead to where that one was left.
        first: leg of that one that follows, counted from 1.
    """

    mission: Mission
    stated: Mission
    name: str
    ahead: int
    first: int


class MissionProgress:
    """Notes how far the mission is flown, and goes on with one that was left.

    Args:
        navigator: flies it.
        link: states the origin of the local frame, and who has control.
        contract_sha256: of the contract as declared.
        identity: names a mission, the same after a restart.
        emit: takes the events.

    Attributes:
        saved: what has to be saved now; `restore` what the last process has left.
    """

    def __init__(
        self,
        navigator: Navigator,
        link: MavlinkEndpoint,
        contract_sha256: str,
        identity: Callable[[Mission], str],
        emit: Callable[[Event], None],
    ) -> None:
        self._navigator, self._link, self._emit = navigator, link, emit
        self._contract_sha256, self._identity = contract_sha256, identity
        self.saved = SavedProgress()
        self._leg_end: tuple[Point, float] = (0.0, 0.0), 0.0
        self._continuation: _Continuation | None = None
        self._due_s = -math.inf
        # Whether this process has found the vehicle in the middle of a flight that was left.
        self._found_in_flight = False
        self._said = True

    def restore(self, saved: SavedProgress) -> None:
        """Take what the last process has left; before the first tick."""
        self.saved = saved
        self._found_in_flight, self._said = saved.leg > 1, not saved.unfinished

    @property
    def resumable(self) -> str | None:
        """Where a flight was left, while none is under way; None if none was."""
        standby = self._navigator.phase is Phase.STANDBY
        return str(self.saved) if standby and self.saved.unfinished else None

    # ------------------------------------------------------------------ noting

    def note(self, pose: Pose | None, now_s: float, now_unix_s: float) -> None:
        """Take note of the leg and the place; call it in every tick."""
        self._ask_in_flight(now_s)
        navigator = self._navigator
        if self.saved.unfinished and self._has_ended():
            self.saved = SavedProgress()
        elif navigator.flying and not self._returning and pose is not None and now_s >= self._due_s:
            self._due_s = now_s + NOTE_PERIOD_S
            self._note_place((pose.position_ned_m[0], pose.position_ned_m[1]), now_unix_s)

    def _has_ended(self) -> bool:
        """Whether the last leg has been flown; the way back may follow."""
        if not self._returning:
            return self._navigator.state is FlightState.ARRIVED
        last, (end_ned_m, width_m) = self.saved.leg == self.saved.legs, self._leg_end
        return last and math.dist(self.saved.place_ned_m, end_ned_m) <= width_m

    @property
    def _returning(self) -> bool:
        return self._navigator.situation.route.returning

    def _note_place(self, place_ned_m: Point, now_unix_s: float) -> None:
        route, continuation = self._navigator.situation.route, self._continuation
        name, leg, legs = self._identity(route.mission), route.index + 1, len(route.mission.legs)
        if continuation is not None and route.mission == continuation.mission:
            if leg <= continuation.ahead:
                return  # on the way to where the flight was left
            leg = leg - continuation.ahead + continuation.first - 1
            name, legs = continuation.name, len(continuation.stated.legs)
        self._leg_end = route.leg.end_ned_m, route.leg.target_half_width_m
        self.saved = SavedProgress(
            mission=name,
            contract_sha256=self._contract_sha256,
            origin_e7=self._origin_e7,
            leg=leg,
            legs=legs,
            place_ned_m=(round(place_ned_m[0], 3), round(place_ned_m[1], 3)),
            time_unix_s=round(now_unix_s, 3),
        )

    def _ask_in_flight(self, now_s: float) -> None:
        """Wait for the operator's word where a flight was left in the air, at a later leg."""
        status = self._link.status
        known = math.isfinite(status.heard_s) and status.airborne is not None
        # A failsafe that ends hands nothing back: only the pilot, or the ground, ends the flight.
        elsewhere = not status.external_control and not status.failsafe
        if known and (elsewhere or not (status.airborne and status.armed)):
            self._found_in_flight = False
        text = None
        if self._found_in_flight:
            text = (
                f"a flight was left at {self.saved}: clearway resume goes on there; take over and "
                "hand back to begin at the first leg"
            )
        self._navigator.situation.left_flight = text
        if self.saved.unfinished and known and not self._said:
            self._said = True
            said = f"a flight was left at {self.saved}: clearway resume goes on there"
            self._emit(Event(now_s, EventName.FLIGHT_LEFT, Severity.NOTICE, said))

    @property
    def _origin_e7(self) -> tuple[int, int] | None:
        origin: Any = self._link.missions.origin
        return None if origin is None else (origin.latitude, origin.longitude)

    # ------------------------------------------------------------------ going on

    def resume(self, pose: Pose | None, now_s: float) -> list[Refusal]:
        """Go on with the flight that was left, as soon as control is granted.

        Args:
            pose: the newest; None before the first.
            now_s: the time.

        Returns:
            Every reason not to; empty if the mission is the next to be flown.
        """
        refusals = [] if pose is not None else [Refusal(RefusalKind.TELEMETRY, "no telemetry")]
        if not self.saved.unfinished:
            text = "no flight of a mission was left unfinished"
            refusals.append(Refusal(RefusalKind.NO_PROGRESS, text))
        else:
            refusals += [Refusal(RefusalKind.PROGRESS_VOID, each) for each in self._changes()]
        if refusals or pose is None:
            return refusals
        situation = self._navigator.situation
        here_ned_m = pose.position_ned_m[0], pose.position_ned_m[1]
        going_on = self._continuation_from(here_ned_m, self._stated)
        if going_on is None:
            return [Refusal(RefusalKind.LEG_FLOWN, "the last leg is already flown")]
        objection = situation.fence_objection(going_on.mission)
        if objection is not None:
            return [Refusal(RefusalKind.GEOFENCE, objection)]
        self._continuation, self._found_in_flight = going_on, False
        self._navigator.change_mission(going_on.mission, now_s)
        situation.left_flight = None
        by = " by way of the place where it was left" if going_on.ahead else ""
        legs = len(going_on.stated.legs)
        leg = f"leg {min(going_on.first, legs)} of {legs}"
        text = f"going on at {leg}{by}, once control is granted"
        self._emit(Event(now_s, EventName.FLIGHT_RESUMED, Severity.NOTICE, text))
        return []

    @property
    def _stated(self) -> Mission:
        """The mission as stated, also while what goes on with it is flown."""
        route, continuation = self._navigator.situation.route, self._continuation
        mission = route.successor or route.mission
        if continuation is not None and mission == continuation.mission:
            return continuation.stated
        return mission

    def _changes(self) -> list[str]:
        """Return what has changed since the flight was left, one sentence each."""
        saved, found = self.saved, []
        stated = self._stated
        if self._identity(stated) != saved.mission or self._left_at(stated) < 0:
            found.append("the mission is another one than that of the flight that was left")
        if saved.contract_sha256 != self._contract_sha256:
            found.append("the contract is another one than that of the flight that was left")
        frame = _FRAMES.get(self._link.profile.key)
        if saved.origin_e7 is None or self._origin_e7 is None or frame is None:
            found.append(
                "home is not known (GPS_GLOBAL_ORIGIN), so that the place cannot be found again"
            )
            return found
        before, now = (
            GeographicPoint(each[0] * _E7, each[1] * _E7)
            for each in (saved.origin_e7, self._origin_e7)
        )
        moved_m = math.hypot(*LocalFrame(before, frame).north_east_m(*now[:2]))
        if not moved_m <= ORIGIN_MOVED_MAX_M:
            found.append(
                f"home has moved by {moved_m:.1f} m since that flight (limit "
                f"{ORIGIN_MOVED_MAX_M:g} m)"
            )
        return found

    def _left_at(self, stated: Mission) -> int:
        """Return which leg of a mission was left, counted from 0.

        Legs are counted from the last one: where the vehicle stands elsewhere, a mission on board
        may have one more leg, to the place of its take-off.
        """
        return len(stated.legs) - self.saved.legs + self.saved.leg - 1

    def _continuation_from(self, here_ned_m: Point, stated: Mission) -> _Continuation | None:
        """Return the mission that begins here and goes on where the flight was left.

        Returns:
            None if the flight was left at its end, and the vehicle is there.
        """
        first, place_ned_m = self._left_at(stated), self.saved.place_ned_m
        if _at(place_ned_m, stated.legs[first].end_ned_m) and first < len(stated.legs) - 1:
            first += 1
        # An avoidance leads aside; what lies within the leg's width is on the way.
        aside_m = max(START_TOLERANCE_M, stated.legs[first].threading_half_width_m)
        ahead: tuple[Leg, ...] = ()
        if math.dist(here_ned_m, place_ned_m) > aside_m:
            ahead = (stated.legs[first].model_copy(update={"end_ned_m": place_ned_m}),)
        elif _at(here_ned_m, stated.legs[first].end_ned_m):
            first += 1
        left = stated.legs[first:]
        if ahead and left and _at(place_ned_m, left[0].end_ned_m):
            left = left[1:]
        if not (ahead or left):
            return None
        mission = stated.model_copy(
            # What the operator has confirmed of the first start says nothing of this one.
            update={
                "start_ned_m": here_ned_m,
                "start_clear_m": None,
                "start_clear_of_movers_m": None,
                "legs": (*ahead, *left),
            }
        )
        return _Continuation(mission, stated, self.saved.mission, len(ahead), first + 1)


def _at(place_ned_m: Point, end_ned_m: Point) -> bool:
    return math.dist(place_ned_m, end_ned_m) < LEG_LENGTH_MIN_M


def mission_sha256(mission: Mission) -> str:
    """Return the identity of a mission by its content."""
    return hashlib.sha256(mission.model_dump_json().encode()).hexdigest()
