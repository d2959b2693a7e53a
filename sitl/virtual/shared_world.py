"""Several simulated vehicles in one world: sensors see the others, contacts between bodies count.

Each vehicle has a local frame of its own, on the Earth where its autopilot takes it to be, and is
really beside that by the error of its position.  What is true is compared in one frame of the site.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations
from typing import Final, NamedTuple

from onboard.geometry.local_frame import LocalFrame
from sitl.environment.movers.movers import REST_MPS
from sitl.environment.movers.other_vehicle import OtherVehicle
from sitl.virtual.simulation import Simulation

Place = tuple[float, float]
Pair = tuple[str, str]


@dataclass(frozen=True)
class Resident:
    """One vehicle of the world.

    Attributes:
        simulation: of the vehicle.
        frame: its local frame, by which it tells where on the Earth it is.
        aside_m: where it really is, north and east of that.
    """

    simulation: Simulation
    frame: LocalFrame
    aside_m: Place


class Contact(NamedTuple):
    """Two bodies that have touched.

    Attributes:
        pair: names of the vehicles.
        time_s: when.
        speeds_mps: of each, in that order.
    """

    pair: Pair
    time_s: float
    speeds_mps: tuple[float, float]

    @property
    def moving(self) -> bool:
        """Whether one of both moved."""
        return max(self.speeds_mps) > REST_MPS


class SharedWorld:
    """The vehicles, in lock step: `place`, then each one's `advance`, then `observe`.

    Bodies are discs, seen from above: two at different heights touch, too.

    Args:
        residents: by name.

    Attributes:
        contacts: of two bodies, as they begin; one that begins at rest counts again where one of
            both moves later.
        apart_min_m: of each pair, the least distance from body to body so far.
    """

    def __init__(self, residents: Mapping[str, Resident]) -> None:
        self._residents = dict(residents)
        first = next(iter(self._residents.values()))
        self._site: Final = LocalFrame(first.frame.origin, "px4")
        self.contacts: list[Contact] = []
        self._places_m = self._true_places()
        self.apart_min_m = dict.fromkeys(combinations(self._residents, 2), math.inf)
        self._touching: dict[Pair, bool] = {}
        self._seen = {
            (name, other): self._added(name, other)
            for name in self._residents
            for other in self._residents
            if other != name
        }

    def apart_m(self, name: str) -> float:
        """Return the least distance of one vehicle's body from another so far."""
        return min(apart_m for pair, apart_m in self.apart_min_m.items() if name in pair)

    def place(self) -> None:
        """Have each vehicle's sensors see the others where they are now."""
        for (name, other), body in self._seen.items():
            truth = self._residents[other].simulation.scene.vehicle.truth
            velocity_ned_mps = truth.velocity_ned_mps[:2]
            body.place(truth.time_s, self._seen_from(name, other), velocity_ned_mps)

    def observe(self) -> None:
        """Look for contacts in the step that all have just made."""
        before, self._places_m = self._places_m, self._true_places()
        for pair in self.apart_min_m:
            one, other = (self._residents[name].simulation.scene for name in pair)
            begin_m = _difference(before[pair[0]], before[pair[1]])
            end_m = _difference(self._places_m[pair[0]], self._places_m[pair[1]])
            apart_m = _nearest_m(begin_m, end_m) - one.world.radius_m - other.world.radius_m
            self.apart_min_m[pair] = min(self.apart_min_m[pair], apart_m)
            if apart_m >= 0.0:
                self._touching.pop(pair, None)
                continue
            truths = one.vehicle.truth, other.vehicle.truth
            speeds_mps = truths[0].ground_speed_mps, truths[1].ground_speed_mps
            contact = Contact(pair, truths[0].time_s, speeds_mps)
            known = self._touching.get(pair)
            if known is None or (contact.moving and not known):
                self.contacts.append(contact)
            self._touching[pair] = contact.moving or bool(known)

    def _added(self, name: str, other: str) -> OtherVehicle:
        radius_m = self._residents[other].simulation.scene.world.radius_m
        body = OtherVehicle(other, radius_m, self._seen_from(name, other))
        self._residents[name].simulation.scene.movers.add(body)
        return body

    def _true_places(self) -> dict[str, Place]:
        """Return where each vehicle really is, in the frame of the site."""
        places = {}
        for name, each in self._residents.items():
            told = each.frame.latitude_longitude_deg(
                *each.simulation.scene.vehicle.truth.position_ned_m[:2]
            )
            north_m, east_m = self._site.north_east_m(*told)
            places[name] = (north_m + each.aside_m[0], east_m + each.aside_m[1])
        return places

    def _seen_from(self, name: str, other: str) -> Place:
        """Return where a vehicle is in the local frame of another."""
        observer = self._residents[name]
        north_m, east_m = _difference(self._places_m[other], observer.aside_m)
        return observer.frame.north_east_m(*self._site.latitude_longitude_deg(north_m, east_m))


def _difference(one_m: Place, other_m: Place) -> Place:
    return one_m[0] - other_m[0], one_m[1] - other_m[1]


def _nearest_m(begin_m: Place, end_m: Place) -> float:
    """Return how near a straight relative motion comes to 0."""
    north_m, east_m = _difference(end_m, begin_m)
    share = -(begin_m[0] * north_m + begin_m[1] * east_m)
    share = min(max(share / max(north_m**2 + east_m**2, 1e-12), 0.0), 1.0)
    return math.hypot(begin_m[0] + share * north_m, begin_m[1] + share * east_m)
