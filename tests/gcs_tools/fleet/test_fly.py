"""``clearway fleet fly``: two vehicles with the whole service whose ways cross."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from onboard.files.yaml_file import dump_document
from onboard.fleet.reservation import Reservation
from onboard.geometry.local_frame import GeographicPoint, LocalFrame
from tests.gcs_tools.running import CONFIG, Clearway

SITE = LocalFrame(GeographicPoint(47.397742, 8.545594), "px4")
# From start to end, north and east of the site's middle, where both would be at the same time.
WAYS = {"right": ((-9.0, -9.0), (9.0, 9.0)), "left": ((-9.0, 9.0), (9.0, -9.0))}
GOOD_NETWORK = ("--loss", "0", "--partitions", "0", "--delay", "0.1", "--restarts", "1e9")


@pytest.fixture
def crossing(tmp_path: Path) -> Path:
    """Write a fleet of two, each with its origin where it stands."""
    vehicles = []
    for name, (start_m, end_m) in WAYS.items():
        latitude_deg, longitude_deg = SITE.latitude_longitude_deg(*start_m)
        leg_ned_m = [end - start for start, end in zip(start_m, end_m, strict=True)]
        mission = {
            "altitude_m": 3.0,
            "start_clear_m": 4.0,
            "legs": [{"end_ned_m": leg_ned_m, "target_half_width_m": 4.0}],
        }
        (tmp_path / f"{name}.yaml").write_text(dump_document(mission), "utf-8")
        vehicles.append(
            {
                "name": name,
                "contract": str(CONFIG / "default_contract.yaml"),
                "mission": f"{name}.yaml",
                "autopilot": "ardupilot",
                "origin": {"latitude_deg": latitude_deg, "longitude_deg": longitude_deg},
                "absolute_position_error_m": 0.05,
            }
        )
    path = tmp_path / "two.yaml"
    path.write_text(dump_document({"speed_max_mps": 6.0, "vehicles": vehicles}), "utf-8")
    return path


def test_one_waits_until_the_other_has_passed(clearway: Clearway, crossing: Path) -> None:
    out = crossing.parent / "out"
    ran = clearway("fleet", "fly", crossing, "-o", out, *GOOD_NETWORK, "--duration", "80")
    assert ran.code == 0, ran
    assert ran.out.startswith("NO CONTACT IN MOTION")
    (flight,) = json.loads((out / "fleet.json").read_text("utf-8"))["flights"].values()
    flown = flight["vehicles"]
    assert [each["arrived"] for each in flown.values()] == [True, True]
    first, last = sorted(each["arrived_s"] for each in flown.values())
    # The leg of 25 m takes 9 s at cruise: the second has begun when the first was past.
    assert last - first > 4.0
    assert min(each["apart_min_m"] for each in flown.values()) > 0.5
    for name in WAYS:
        result = json.loads((out / name / "result.json").read_text("utf-8"))
        assert (result["outcome"], result["collisions"]) == ("arrived", 0)
        assert clearway("report", out / name).code == 0


def test_without_asking_they_collide(
    clearway: Clearway, crossing: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The verdict above is not empty: as soon as no peer is asked, the bodies meet."""
    monkeypatch.setattr(Reservation, "_need", lambda *_: frozenset())
    monkeypatch.setattr(Reservation, "_held_by_peers", lambda _: iter(()))
    out = crossing.parent / "out"
    ran = clearway("fleet", "fly", crossing, "-o", out, *GOOD_NETWORK, "--duration", "60")
    assert ran.code == 1, ran
    assert ran.out.startswith("CONTACT IN MOTION in 1 of 1 flights (seeds 1)")
    assert "contact in motion: right and left" in ran.out
