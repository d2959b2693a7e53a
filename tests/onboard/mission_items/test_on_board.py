"""What an autopilot sends by the mission protocol, as a ground station's file would hold it."""

from types import SimpleNamespace
from typing import Any

import pytest

from onboard.mission_items.on_board import OnBoard, OnBoardError, planned_of

HOME = {"latitude": 473977000, "longitude": 85456000, "altitude": 488000}
ORIGIN = {"latitude": 473977100, "longitude": 85456000, "altitude": 487000}


def item(seq: int, command: int, north_e7: int = 0, *, param1: float = 0.0, z: float = 5.0) -> Any:
    return SimpleNamespace(
        seq=seq, command=command, frame=3, param1=param1, param2=0.0, param3=0.0, param4=0.0,
        x=473977000 + north_e7, y=85456000, z=z,
    )  # fmt: skip


def on_board(*items: Any, **changes: Any) -> OnBoard:
    stated: dict[str, Any] = {"autopilot": "px4", "fence": [], "home": HOME, "origin": ORIGIN}
    return OnBoard(items=items, **(stated | changes))


def test_items_home_and_origin_are_read() -> None:
    planned = planned_of(on_board(item(0, 22), item(1, 16, 4000)))
    assert [(each.name, each.command) for each in planned.items] == [("item 0", 22), ("item 1", 16)]
    assert planned.items[1].place == pytest.approx((47.3981, 8.5456, 5.0))
    assert planned.home == pytest.approx((47.3977, 8.5456, 488.0))
    assert planned.origin == pytest.approx((47.39771, 8.5456, 487.0))
    assert planned.autopilot == "px4"


def test_item_0_of_ardupilot_is_home() -> None:
    sent = on_board(item(0, 16), item(1, 22), item(2, 16), autopilot="ardupilot")
    assert [each.name for each in planned_of(sent).items] == ["item 1", "item 2"]


def test_a_geofence_stays_geographic() -> None:
    corners = [item(n, 5001, 1000 * n, param1=3.0) for n in range(3)]
    planned = planned_of(on_board(item(0, 16), fence=[*corners, item(3, 5004, param1=7.0)]))
    polygon, circle = planned.fence
    assert [corner[0] for corner in polygon.corners] == pytest.approx([47.3977, 47.3978, 47.3979])
    assert polygon.keeps_in
    assert (circle.radius_m, circle.keeps_in) == (7.0, False)


def test_without_home_or_of_an_unknown_autopilot_nothing_is_made_up() -> None:
    planned = planned_of(on_board(item(0, 16), home=None, origin=None, autopilot="other"))
    assert (planned.home, planned.origin, planned.autopilot) == (None, None, None)


@pytest.mark.parametrize(
    ("sent", "words"),
    [
        (on_board(), "no mission on board"),
        (on_board(item(0, 16), autopilot="ardupilot"), "no mission on board"),
        (on_board(item(0, 16), fence=[item(0, 5001, param1=3.0)]), "1 corners in a row"),
    ],
)
def test_what_is_no_mission_is_refused(sent: OnBoard, words: str) -> None:
    with pytest.raises(OnBoardError, match=words):
        planned_of(sent)
