"""Flies the mission that the autopilot has on board, and follows its changes on the ground."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Final

from onboard.events import Event, EventName, Severity
from onboard.files.daemon_config import VehicleMission
from onboard.files.geofence_file import FenceAreaFile
from onboard.files.mission_file import Leg, Mission
from onboard.guidance.navigator import Navigator
from onboard.guidance.phases import Phase
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.mission_reader import ReadMission
from onboard.mission_items.interpretation import FlyableMission, flyable
from onboard.mission_items.on_board import OnBoard, OnBoardError

# Stands in until the vehicle's mission has been read; nothing departs on it.
PLACEHOLDER: Final = Mission(altitude_m=100.0, legs=(Leg(end_ned_m=(1.0, 0.0)),))

_ITEM_FIELDS: Final = (
    "mission_type",
    "command",
    "frame",
    *("param1", "param2", "param3", "param4"),
    *("x", "y", "z"),
)


class MissionFromVehicle:
    """Takes over what the link has read, where it can be flown.

    In flight nothing changes: a mission that is uploaded then is flown after it.

    Args:
        link: reads the vehicle.
        navigator: flies the mission.
        stated: what a mission on board does not state.
        keep_in: takes the areas of the geofence.
        emit: takes the events.
    """

    def __init__(
        self,
        link: MavlinkEndpoint,
        navigator: Navigator,
        stated: VehicleMission,
        keep_in: Callable[[tuple[FenceAreaFile, ...]], None],
        emit: Callable[[Event], None],
    ) -> None:
        link.missions.wanted = True
        self._link, self._navigator = link, navigator
        self._stated, self._keep_in, self._emit = stated, keep_in, emit
        self._taken: ReadMission | None = None
        self._flown: FlyableMission | None = None
        self._pending: FlyableMission | None = None
        self._refused: str | None = None
        self._doubt_said: str | None = None

    @property
    def summary(self) -> str:
        """What was read, for people; empty before."""
        return "" if self._flown is None else self._flown.summary

    def identity(self, mission: Mission) -> str | None:
        """Name the mission on board by its items, which no origin moves; None for another one."""
        flown, read = self._flown, self._taken
        if flown is None or read is None or mission != flown.mission:
            return None
        stated = self._stated.model_dump_json()
        items = [
            [getattr(item, name) for name in _ITEM_FIELDS] for item in (*read.items, *read.fence)
        ]
        return hashlib.sha256(f"{stated} {items}".encode()).hexdigest()

    def follow(self, now_s: float) -> None:
        """Take what has been read since the last tick; refuse to depart while it is in doubt."""
        read = self._link.missions.read
        if read is not None and read is not self._taken:
            self._taken = read
            self._take(read, now_s)
        if self._pending is not None and self._navigator.phase is Phase.STANDBY:
            self._fly(self._pending, now_s)
        doubt = self._refused or self._link.missions.doubt
        if self._flown is None and doubt is None:
            doubt = "the vehicle's mission is being read"
        self._navigator.situation.mission_doubt = doubt
        if doubt != self._doubt_said:
            self._doubt_said = doubt
            if doubt is not None and "being read" not in doubt:
                self._refuse(doubt, now_s)

    def _take(self, read: ReadMission, now_s: float) -> None:
        on_board = OnBoard(
            self._link.profile.key,
            read.items,
            read.fence,
            None if read.home is None else read.home.to_dict(),
            None if read.origin is None else read.origin.to_dict(),
        )
        self._refused = None
        try:
            found = flyable(on_board, self._stated)
        except OnBoardError as error:
            self._refused = f"the vehicle's mission cannot be flown: {error}"
            return
        if found == self._flown:
            self._pending = None
            return
        self._pending = found
        if self._navigator.phase is not Phase.STANDBY:
            text = "the mission on the vehicle has changed: it is flown after this flight"
            self._emit(Event(now_s, EventName.MISSION_READ, Severity.WARNING, text))

    def _fly(self, found: FlyableMission, now_s: float) -> None:
        self._pending, self._flown = None, found
        self._keep_in(found.areas)
        objection = self._navigator.situation.fence_objection(found.mission)
        if objection is not None:
            # Not flown: read once more, as over every arming, it has to be refused once more.
            self._flown = None
            self._refused = f"the vehicle's mission cannot be flown: {objection}"
            return
        self._navigator.change_mission(found.mission, now_s)
        text = f"mission read from the vehicle: {found.summary}"
        self._emit(Event(now_s, EventName.MISSION_READ, Severity.NOTICE, text))

    def _refuse(self, doubt: str, now_s: float) -> None:
        text = f"mission refused: {doubt}"
        self._emit(Event(now_s, EventName.MISSION_REFUSED, Severity.WARNING, text))
