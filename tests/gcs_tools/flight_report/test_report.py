"""`clearway report`: what the page says of a flight, of two, and of damaged logs."""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import Writer

from gcs_tools.flight_report.command import write_report
from gcs_tools.flight_report.document import document_of
from gcs_tools.flight_report.flight import Document, read_flight
from gcs_tools.logs.flight_log import read_log
from onboard.recording.flight_log import FORMAT_VERSION, FlightLog
from onboard.recording.messages import EventRecord, StateRecord, as_json
from tests.gcs_tools.browser import Page, chromium
from tests.gcs_tools.logs.raw_log import raw_log
from tests.gcs_tools.running import CONFIG, Clearway

EPOCH_S = 1_790_000_000.0


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The paper's flight in virtual time."""
    from gcs_tools.fly.command import fly  # noqa: PLC0415  only this fixture needs the simulation

    out = tmp_path_factory.mktemp("flights") / "paper-1"
    assert fly(CONFIG / "paper.yaml", virtual=True, seed=1, out=out, fly_outside_contract=False)
    return out


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with chromium(tmp_path_factory.mktemp("profile")) as page:
        yield page


def data_in(report: Path) -> list[Document]:
    """The documents that a page carries."""
    page = report.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page)
    assert found is not None
    documents: list[Document] = json.loads(found[1])
    return documents


# ---------------------------------------------------------------------------- the document


def test_the_document_tells_the_paper_s_flight(flown: Path) -> None:
    document = document_of(read_flight(flown))
    assert (document["outcome"], document["succeeded"]) == ("arrived", True)
    assert document["problems"] == []
    assert [step["obstacle"] for step in document["steps"]] == ["front/1", "front/2", "front/3"]
    for step in document["steps"]:
        assert step["pre_condition"] is True
        assert step["post_condition"] is True
        assert 0.0 < step["clearance_m"] < 1.0
        assert step["time_s"] < step["end_s"]
    result = json.loads((flown / "result.json").read_text(encoding="utf-8"))
    least_m = min(step["clearance_m"] for step in document["steps"])
    assert least_m == pytest.approx(result["clearance_min_m"], abs=0.01)
    path = document["path"]
    errors_m = [error for error in path["tracking_error_m"] if error is not None]
    assert max(errors_m) == pytest.approx(result["tracking_error_max_m"], abs=1e-4)
    heights_m = [height for height in path["height_m"] if height is not None]
    assert (heights_m[0], heights_m[-1]) == pytest.approx((0.0, 0.0), abs=0.1)
    assert max(heights_m) > 3.5
    along_mps, across_mps = (
        [error for error in path[f"velocity_error_{way}_mps"] if error is not None]
        for way in ("along", "across")
    )
    assert [max(along_mps), max(across_mps)] == pytest.approx(
        result["velocity_error_max_mps"], abs=1e-4
    )
    # Detections come every 0.1 s at the latest: the tops of the saw-tooth.
    ages_s = [age for age in path["detection_age_s"][100:] if age is not None]
    assert 0.03 < min(ages_s) <= max(ages_s) < 0.15
    assert max(document["known"]["clearance_m"]) > 5.0
    assert len(document["truth"]["rpm"]) == 4
    assert {clause["name"] for clause in document["clauses"]} >= {"thrust", "separation"}
    assert all(value < 100.0 for c in document["clauses"] for value in c["values"])
    assert len({len(column) for column in path.values()}) == 1


def test_obstacles_appear_when_they_are_seen(flown: Path) -> None:
    document = document_of(read_flight(flown))
    obstacles = document["obstacles"]
    first = {o["id"]: o["since_s"] for o in reversed(obstacles)}
    assert first["front/1"] < first["front/2"] < first["front/3"]
    assert {o["id"] for o in obstacles if o["until_s"] is None} == set(first)
    assert all(o["until_s"] is None or o["since_s"] < o["until_s"] for o in obstacles)


# ---------------------------------------------------------------------------- bad input


@pytest.fixture
def logged(tmp_path: Path) -> Callable[..., Path]:
    """Write a log of states 50 times a second, for so many seconds."""

    def write(duration_s: float = 4.0, **metadata: str) -> Path:
        path = tmp_path / "some.mcap"
        with FlightLog(path, metadata) as log:
            log.write(states(round(duration_s * 50)))
        return path

    return write


def states(count: int) -> Iterator[StateRecord]:
    for number in range(count):
        time_s = EPOCH_S + number * 0.02
        wave = math.sin(number / 40.0)
        yield StateRecord(
            time_s=time_s, phase="cruise", mode="OFFBOARD", armed=True, airborne=True,
            position_ned_m=(number * 0.05, wave, -4.0), velocity_ned_mps=(2.5, wave / 2.0, 0.0),
            roll_rad=0.1 * wave, pitch_rad=-0.02, yaw_rad=0.0,
            reference_position_ned_m=(number * 0.05, wave + 0.01, -4.0),
            reference_velocity_ned_mps=(2.5, wave / 2.0, 0.0),
            reference_acceleration_ned_mps2=(0.0, 0.0, 0.0),
            tracking_error_m=0.17 if number == count // 2 else 0.01,
            velocity_error_mps=(0.01, 0.01), cruising=True, detection_age_s=0.05,
        )  # fmt: skip


def test_a_killed_flight_is_shown_as_far_as_it_was_written(
    clearway: Clearway, flown: Path, tmp_path: Path
) -> None:
    data = (flown / "flight.mcap").read_bytes()
    (tmp_path / "flight.mcap").write_bytes(data[: len(data) // 2])
    ran = clearway("report", tmp_path)
    assert ran.code == 0
    assert "breaks off" in ran.err
    (document,) = data_in(tmp_path / "report.html")
    assert "breaks off" in document["problems"][0]
    assert len(document["path"]["time_s"]) > 100
    assert document["outcome"] == "aborted"


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "is not a flight log"),
        (b"PK\x03\x04 something else altogether", "is not a flight log"),
        (b"\x89MCAP0\r\n", "is not a flight log"),
    ],
)
def test_what_is_no_log_is_one_line(
    clearway: Clearway, tmp_path: Path, content: bytes, complaint: str
) -> None:
    path = tmp_path / "what.mcap"
    path.write_bytes(content)
    ran = clearway("report", path)
    assert ran.code == 2
    assert ran.err.startswith("clearway: error: ")
    assert complaint in ran.err
    assert ran.err.count("\n") == 1


def test_a_missing_log_is_named(clearway: Clearway, tmp_path: Path) -> None:
    ran = clearway("report", tmp_path / "nowhere.mcap")
    assert (ran.code, ran.out) == (2, "")
    assert "nowhere.mcap: cannot be read" in ran.err


def test_somebody_else_s_mcap_is_refused(clearway: Clearway, tmp_path: Path) -> None:
    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/Imu", "ros1msg", b"")
        channel = writer.register_channel("/imu", "ros1", schema)
        writer.add_message(channel, 0, b"\x00\x01", 0)
        writer.finish()  # type: ignore[no-untyped-call]  # untyped in its own source
    ran = clearway("report", path)
    assert ran.code == 2
    assert "not a log of Clearway" in ran.err


def test_a_log_without_a_flight_says_so(clearway: Clearway, tmp_path: Path) -> None:
    with FlightLog(tmp_path / "short.mcap", {}):
        pass
    ran = clearway("report", tmp_path / "short.mcap")
    assert ran.code == 2
    assert "nothing was recorded" in ran.err


def test_a_log_from_the_future_is_shown_as_far_as_it_is_understood(
    clearway: Clearway, tmp_path: Path
) -> None:
    path = tmp_path / "future.mcap"
    with raw_log(path, format_version=str(FORMAT_VERSION + 1), contract="{}") as write:
        for state in states(100):
            known = {"phase": state.phase, "position_ned_m": state.position_ned_m}
            write("state", state.time_s, {"time_s": state.time_s, **known, "warp_factor": 9})
    ran = clearway("report", path)
    assert ran.code == 0
    assert f"has format {FORMAT_VERSION + 1}" in ran.err
    (document,) = data_in(tmp_path / "report.html")
    assert document["outcome"] == "unknown"
    assert document["path"]["north_m"][-1] == pytest.approx(99 * 0.05)
    assert document["path"]["tracking_error_m"] == [None] * 100


def test_records_that_make_no_sense_are_left_out_and_counted(
    clearway: Clearway, tmp_path: Path
) -> None:
    path = tmp_path / "odd.mcap"
    odd: list[dict[str, Any]] = [
        {"phase": "cruise"},
        {"time_s": "noon"},
        {"time_s": EPOCH_S, "position_ned_m": [1.0, "x", 2.0]},
        {"time_s": EPOCH_S, "position_ned_m": [1.0]},
    ]
    with raw_log(path) as write:
        for state in states(50):
            write("state", state.time_s, as_json(state))
        for payload in odd:
            write("state", EPOCH_S + 1.0, payload)
        write("margins", EPOCH_S, {"time_s": EPOCH_S, "clauses": {"stop": 3}})
        write("obstacles", EPOCH_S, {"time_s": EPOCH_S, "obstacles": [{}]})
    ran = clearway("report", path)
    assert ran.code == 0
    assert "4 of 54 records of /state are malformed" in ran.err
    assert "1 of 1 records of /margins are malformed" in ran.err
    (document,) = data_in(tmp_path / "report.html")
    assert len(document["path"]["time_s"]) == 50
    assert (document["margins"], document["obstacles"]) == ([], [])


@pytest.mark.parametrize("truth", [b"", b"no log at all"])
def test_a_broken_ground_truth_costs_only_itself(
    clearway: Clearway, flown: Path, tmp_path: Path, truth: bytes
) -> None:
    shutil.copy(flown / "flight.mcap", tmp_path)
    (tmp_path / "truth.mcap").write_bytes(truth)
    ran = clearway("report", tmp_path)
    assert ran.code == 0
    assert "truth.mcap: is not a flight log" in ran.err
    (document,) = data_in(tmp_path / "report.html")
    assert document["truth"]["rpm"] == []
    assert len(document["path"]["time_s"]) > 1000


def test_ten_minutes_fit_and_keep_their_peak(
    clearway: Clearway, logged: Callable[..., Path], tmp_path: Path
) -> None:
    log = logged(600.0)
    assert clearway("report", log, "-o", tmp_path / "long.html").code == 0
    (document,) = data_in(tmp_path / "long.html")
    assert (tmp_path / "long.html").stat().st_size < 10e6
    assert 0.17 in document["path"]["tracking_error_m"]
    assert len(document["path"]["time_s"]) <= 6000


def test_markup_in_a_log_stays_text(clearway: Clearway, tmp_path: Path) -> None:
    path = tmp_path / "evil.mcap"
    with FlightLog(path, {}) as log:
        log.write(states(10))
        text = "</script><script>alert(1)</script>"
        event = EventRecord(time_s=EPOCH_S, name="violation", severity="error", text=text)
        log.write([event])
    assert clearway("report", path).code == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert text not in page
    (document,) = data_in(tmp_path / "report.html")
    assert document["events"][0]["text"] == text


def test_an_unwritable_report_is_one_line(clearway: Clearway, logged: Callable[..., Path]) -> None:
    ran = clearway("report", logged(), "-o", "/proc/report.html")
    assert ran.code == 2
    assert "cannot be written" in ran.err


# ---------------------------------------------------------------------------- in a browser


def opened(browser: Page, report: Path, **screen: Any) -> Page:
    browser.complaints.clear()
    browser.look_like(screen.get("width_px", 1280), 900, theme=screen.get("theme", "light"))
    browser.open(report.as_uri())
    return browser


def place(page: Page, vehicle: str = "vehicle") -> tuple[float, float]:
    """Where the map shows a vehicle: north and east."""
    transform = page.evaluate(f"document.getElementById('{vehicle}').getAttribute('transform')")
    found = re.match(r"translate\(([-\d.e]+) ([-\d.e]+)\)", transform)
    assert found is not None
    return float(found[1]), float(found[2])


def slide_to(page: Page, time_s: float) -> None:
    page.evaluate(
        f"(() => {{ const slider = document.getElementById('time'); slider.value = {time_s};"
        "slider.dispatchEvent(new Event('input')); })()"
    )


def test_the_slider_moves_the_vehicle_along_the_log(
    clearway: Clearway, browser: Page, flown: Path, tmp_path: Path
) -> None:
    assert clearway("report", flown, "-o", tmp_path / "report.html").code == 0
    page = opened(browser, tmp_path / "report.html")
    (document,) = data_in(tmp_path / "report.html")
    path = document["path"]
    for time_s in (3.0, 12.0, 20.0):
        slide_to(page, time_s)
        nearest = min(range(len(path["time_s"])), key=lambda i: abs(path["time_s"][i] - time_s))
        expected = path["north_m"][nearest], path["east_m"][nearest]
        assert place(page) == pytest.approx(expected, abs=0.1)
        assert f"north {expected[0]:.1f}"[:8] in page.evaluate(
            "document.getElementById('readout').textContent"
        )
    assert page.evaluate("document.getElementById('verdict').textContent") == "ARRIVED"
    assert page.evaluate("document.querySelectorAll('#steps tbody tr').length") == 3
    assert page.evaluate("document.querySelectorAll('#map .region').length") == 3
    charts = page.evaluate("[...document.querySelectorAll('svg.chart')].map((c) => c.ariaLabel)")
    # Every quantity of the paper's Fig. 15 to 17, and the margins.
    assert set(charts) >= {
        "Position north", "Position east", "Altitude",
        "Velocity north", "Velocity east", "Velocity upwards",
        "Tilt", "Heading", "Rotor speeds, ground truth", "Tracking error",
        "Contract used: required as a share of declared",
    }  # fmt: skip
    page.until("document.getElementById('band').textContent")  # drawn once its size is known
    band = page.evaluate("document.getElementById('band').textContent")
    assert all(f"front/{number}" in band for number in (1, 2, 3))
    assert band.count("✓") == 6
    assert "✗" not in band
    assert page.evaluate(
        "[...document.querySelectorAll('svg.chart')].every((c) => c.querySelector('.cursor'))"
    )
    assert page.complaints == []


def test_a_click_on_an_event_goes_there(
    clearway: Clearway, browser: Page, flown: Path, tmp_path: Path
) -> None:
    clearway("report", flown, "-o", tmp_path / "report.html")
    page = opened(browser, tmp_path / "report.html")
    time_s = page.evaluate(
        "(() => { const row = document.querySelectorAll('#steps tr[data-time]')[1];"
        "row.click(); return Number(row.dataset.time); })()"
    )
    assert page.evaluate("Number(document.getElementById('time').value)") == pytest.approx(
        time_s, abs=0.02
    )


def test_play_moves_on_by_itself(
    clearway: Clearway, browser: Page, flown: Path, tmp_path: Path
) -> None:
    clearway("report", flown, "-o", tmp_path / "report.html")
    page = opened(browser, tmp_path / "report.html")
    # It opens at the end of the mission; the replay begins at the start, once.
    assert place(page)[0] > 45.0
    page.evaluate("document.getElementById('rate').value = '16'")
    page.evaluate("document.getElementById('play').click()")
    page.until("Number(document.getElementById('time').value) < 5")
    page.until("Number(document.getElementById('time').value) > 10")
    assert 5.0 < place(page)[0] < 45.0
    assert page.complaints == []


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_fits_a_phone_in_both_themes(
    clearway: Clearway, browser: Page, flown: Path, tmp_path: Path, theme: str
) -> None:
    clearway("report", flown, "-o", tmp_path / "report.html")
    page = opened(browser, tmp_path / "report.html", width_px=390, theme=theme)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert ground == ("rgb(255, 255, 255)" if theme == "light" else "rgb(18, 23, 29)")
    # Every phase that is as wide as a line of text has its label, turned where it must be.
    page.until("document.getElementById('band').textContent")
    phases = data_in(tmp_path / "report.html")[0]["phases"]
    labels = page.evaluate("[...document.querySelectorAll('#band text:not(.tick)')].length")
    turned = page.evaluate("document.querySelectorAll('#band text[transform]').length")
    assert turned >= 1
    assert labels >= len(phases)
    band = page.evaluate("document.getElementById('band').textContent")
    assert all(word in band for word in ("front/1", "front/3", "standby", "✓", "10 s"))
    page.screenshot(tmp_path / "phone.png")
    assert (tmp_path / "phone.png").stat().st_size > 10_000
    assert page.complaints == []


def test_a_held_flight_opens_at_its_violation_and_says_why_on_the_map(
    browser: Page, flown: Path, tmp_path: Path
) -> None:
    document = document_of(read_flight(flown))
    at_s, text = 12.0, "tracking_error: 0.37, limit 0.35 m"
    mark = {"time_s": at_s, "kind": "hold", "text": text, "place_ned_m": [20.0, -1.0]}
    document |= {"opens_at_s": at_s, "marks": [mark], "outcome": "held", "succeeded": False}
    write_report([document], tmp_path / "report.html")
    page = opened(browser, tmp_path / "report.html")
    why = "document.getElementById('why').textContent"
    assert page.evaluate("Number(document.getElementById('time').value)") == at_s
    assert page.evaluate(why) == f"12.0 s: {text}"
    placed = page.evaluate("document.querySelector('#map .mark').getAttribute('transform')")
    assert placed.startswith("translate(20 -1) scale(")
    # Obstacles that were known only later are drawn, too, and the true ones.
    assert page.evaluate("document.querySelectorAll('#map .obstacle').length") < 3
    drawn = "document.querySelector('#map .{}').getAttribute('d').split('M').length - 1"
    assert page.evaluate(drawn.format("seen-elsewhere")) >= 1
    assert page.evaluate(drawn.format("true-obstacle")) == 3
    bar = page.evaluate("document.querySelector('#map .scale text').textContent")
    assert re.fullmatch(r"[125]0* m", bar)
    slide_to(page, at_s - 1.0)
    assert page.evaluate("document.getElementById('why').hidden") is True
    assert page.evaluate("document.querySelectorAll('#map .mark').length") == 0
    assert page.complaints == []


def test_two_flights_are_laid_over_each_other(
    clearway: Clearway, browser: Page, flown: Path, logged: Callable[..., Path], tmp_path: Path
) -> None:
    assert clearway("report", flown, logged(20.0), "-o", tmp_path / "both.html").code == 0
    page = opened(browser, tmp_path / "both.html")
    slide_to(page, 10.0)
    assert place(page, "other-vehicle")[0] == pytest.approx(10.0 / 0.02 * 0.05, abs=0.2)
    assert place(page)[0] > 1.0
    assert page.evaluate("document.querySelector('#map .other').getAttribute('d').length") > 100
    outcomes = "[...document.querySelectorAll('#facts tbody tr')][0].textContent"
    assert page.evaluate(outcomes) == "outcomearrivedaborted"
    assert page.evaluate("document.getElementById('verdict').textContent") == "ARRIVED"
    assert page.evaluate("document.getElementById('other-verdict').textContent") == "ABORTED"
    assert page.evaluate("document.getElementById('other-verdict').className") == "verdict bad"
    names = "[...document.querySelectorAll('header h1')].map((h) => h.textContent)"
    assert page.evaluate(names) == ["paper-1", "some"]
    # To be replayed to the end of the one that took longer.
    ends_s = [document["span_s"][1] for document in data_in(tmp_path / "both.html")]
    assert page.evaluate("Number(document.getElementById('time').max)") == max(ends_s)
    page.look_like(390, 844)
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    assert page.complaints == []


def test_a_broken_log_still_renders(
    clearway: Clearway, browser: Page, flown: Path, tmp_path: Path
) -> None:
    shutil.copy(flown / "truth.mcap", tmp_path / "truth.mcap")
    data = (flown / "flight.mcap").read_bytes()
    (tmp_path / "flight.mcap").write_bytes(data[: len(data) // 3])
    assert not read_log(tmp_path / "flight.mcap").complete
    clearway("report", tmp_path)
    page = opened(browser, tmp_path / "report.html")
    assert "breaks off" in page.evaluate("document.querySelector('.problem').textContent")
    assert page.complaints == []
