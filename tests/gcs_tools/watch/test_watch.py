"""`clearway watch`: what is kept and served, and the page against a flight that is going on."""

from __future__ import annotations

import http.client
import json
import math
import re
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from rich.console import Console

from gcs_tools.logs.flight_log import read_log
from gcs_tools.watch.feed import _BACKLOG, EVENTS_KEPT, Feed, Message
from gcs_tools.watch.server import serving
from gcs_tools.watch.terminal import view
from onboard.files.contract_file import load_contract
from onboard.recording.messages import StateRecord
from tests.gcs_tools.browser import Page, chromium
from tests.gcs_tools.running import CONFIG, Clearway, children_of, is_alive, until
from tests.gcs_tools.terminal import terminal

CONTRACT = load_contract(CONFIG / "paper_contract.yaml")
STATUS = {
    "time_s": 1_790_000_000.0, "phase": "avoid", "mode": "OFFBOARD", "armed": True,
    "position_ned_m": [12.0, 0.5, -4.0], "velocity_ned_mps": [2.0, 0.1, 0.0], "yaw_rad": 0.0,
    "goal_ned_m": [46.0, 0.0], "battery_charge": 0.17, "obstacles_known": 2,
    "dropped": {"frames_malformed": 3},
}  # fmt: skip
MONITORS = {
    "time_s": 1_790_000_000.0,
    "tracking_error": {"measured": 0.31, "limit": 0.25, "unit": "m"},
    "detection_age": {"measured": None, "limit": 0.3, "unit": "s"},
    "clearance": {"measured": 1.5, "limit": 0.0, "unit": "m"},
}
MARGINS = {
    "time_s": 1_790_000_000.0, "compliant": False, "binding": "stop",
    "clauses": [
        {"name": "separation", "required": 0.3, "declared": 1.0, "margin": 0.7, "unit": "m",
         "holds": True},
        {"name": "stop", "required": 0.3, "declared": 0.2, "margin": -0.1, "unit": "m",
         "holds": False},
    ],
}  # fmt: skip
SEEN_SPACE = {
    "time_s": 1_790_000_000.0, "corner_ned_m": [9.0, -2.0], "heading_rad": math.pi / 2.0,
    "cell_m": 0.5, "row": [0, 1], "column_from": [0, 2], "column_to": [4, 4],
    "way_to_rest_ned_m": [[12.0, 0.5], [13.0, 0.5]], "guide_ned_m": [[12.0, 0.5], [20.0, 0.0]],
    "pause": "nothing better certifies",
}  # fmt: skip

MOVERS = {
    "time_s": 1_790_000_000.0, "until_s": 1_790_000_001.5, "stamp_error_s": 0.1, "left_out": 2,
    "movers": [
        {"id": "ring/1", "kind": "person", "seen_s": 1_789_999_999.9, "speed_max_mps": 1.0,
         "box_ned_m": [[15.0, 0.0], [16.0, 0.0], [16.0, 1.0], [15.0, 1.0]],
         "reach_ned_m": [[13.0, -2.0], [18.0, -2.0], [18.0, 3.0], [13.0, 3.0]],
         "yields_for": True},
    ],
    "yielding": "mover ring/1 may be on the way", "missing": "1 of 3 frames have counted",
    "corner_ned_m": [2.0, -6.0], "cell_m": 0.5, "row": [0], "column_from": [1], "column_to": [4],
}  # fmt: skip


def said(feed: Feed, key: str, payload: Any) -> None:
    feed.receive(key, json.dumps(payload).encode())


def payload_of(message: Message) -> dict[str, Any]:
    document = json.loads(message.as_json())
    assert document["key"] == message.key
    payload: dict[str, Any] = document["payload"]
    return payload


def violation(number: int) -> dict[str, Any]:
    return {
        "time_s": 0.0,
        "name": "violation",
        "severity": "error",
        "text": f"event {number}",
        "data": {},
    }


# ---------------------------------------------------------------------------- the feed


def test_who_joins_late_gets_what_lasts_the_path_and_the_events() -> None:
    feed = Feed()
    for north_m in range(3):
        said(feed, "status", {**STATUS, "position_ned_m": [north_m, 0.0, -4.0]})
    said(feed, "margins", MARGINS)
    for number in range(EVENTS_KEPT + 5):
        said(feed, "events", violation(number))
    missed, count = feed.snapshot()
    by_key: dict[str, list[dict[str, Any]]] = {}
    for message in missed:
        by_key.setdefault(message.key, []).append(payload_of(message))
    assert by_key["trail"][0]["points_ned_m"] == [[n, 0.0, -4.0] for n in range(3)]
    assert by_key["status"][0]["position_ned_m"] == [2, 0.0, -4.0]
    assert by_key["margins"] == [MARGINS]
    assert [e["text"] for e in by_key["events"]] == [
        f"event {n}" for n in range(5, EVENTS_KEPT + 5)
    ]
    said(feed, "events", violation(999))
    fresh, _ = feed.wait(count, 0.0)
    assert [payload_of(message)["text"] for message in fresh] == ["event 999"]


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"\xff", b"[1, 2]", b"null", b"{", b"{}"),
        b'{"time_s": "noon"}',
        b'{"time_s": 1.0, "position_ned_m": [1.0, 2.0]}',
        b'{"time_s": 1.0, "position_ned_m": [NaN, 2.0, 3.0]}',
    ],
)
def test_malformed_messages_are_counted_and_dropped(data: bytes) -> None:
    feed = Feed()
    feed.receive("status", data)
    assert feed.dropped == 1
    assert feed.latest(StateRecord) is None


def test_a_listener_that_fell_behind_starts_anew() -> None:
    feed = Feed()
    for number in range(_BACKLOG + 10):
        said(feed, "events", violation(number))
    messages, _ = feed.wait(0, 0.0)
    assert [message.key for message in messages].count("trail") == 1
    assert [message.key for message in messages][-1] == "departure"
    assert len(messages) == 2 + EVENTS_KEPT


def test_closing_lets_a_waiting_listener_go() -> None:
    feed = Feed()
    waiting = threading.Thread(target=feed.wait, args=(0, 60.0))
    waiting.start()
    feed.close()
    waiting.join(timeout=60.0)
    assert not waiting.is_alive()


# ---------------------------------------------------------------------------- the server


@contextmanager
def asked(
    url: str, path: str, method: str = "GET", **headers: str
) -> Iterator[http.client.HTTPResponse]:
    connection = http.client.HTTPConnection(urlsplit(url).netloc, timeout=60.0)
    try:
        connection.request(method, path, headers=headers)
        yield connection.getresponse()
    finally:
        connection.close()


def test_the_stream_begins_with_what_is_known_and_goes_on() -> None:
    feed = Feed()
    said(feed, "status", STATUS)
    with serving(feed, "v1", "127.0.0.1", 0) as url, asked(url, "/stream") as answer:
        assert answer.headers["Content-Type"] == "text/event-stream"

        def next_message() -> dict[str, Any]:
            while not (line := answer.readline()).startswith(b"data: "):
                assert line, "the stream ended"
            message: dict[str, Any] = json.loads(line.removeprefix(b"data: "))
            return message

        first = [next_message()["key"] for _ in range(3)]
        assert first == ["status", "trail", "departure"]
        said(feed, "events", violation(1))
        assert next_message() == {"key": "events", "payload": violation(1)}


@pytest.mark.parametrize(
    ("path", "method", "headers", "status"),
    [
        ("/", "GET", {}, 200),
        ("/etc/passwd", "GET", {}, 404),
        ("/", "POST", {}, 501),
        ("/", "GET", {"Host": "evil.example:80"}, 403),
    ],
)
def test_it_serves_one_page_to_this_computer_and_takes_nothing(
    path: str, method: str, headers: dict[str, str], status: int
) -> None:
    with (
        serving(Feed(), "v1", "127.0.0.1", 0) as url,
        asked(url, path, method, **headers) as answer,
    ):
        assert answer.status == status


def test_a_port_in_use_is_one_line(clearway: Clearway) -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        ran = clearway("watch", "--port", holder.getsockname()[1])
    assert ran.code == 2
    assert "cannot be served on" in ran.err
    assert ran.err.count("\n") == 1


# ---------------------------------------------------------------------------- in a terminal


def rendered(feed: Feed, now_unix_s: float) -> str:
    console = Console(width=100, record=True, file=open("/dev/null", "w"))  # noqa: PTH123, SIM115
    console.print(view(feed, "v1", now_unix_s))
    console.file.close()
    return console.export_text()


def test_the_terminal_shows_what_the_page_shows() -> None:
    feed = Feed()
    assert "waiting for the daemon" in rendered(feed, 0.0)
    for key, payload in {"status": STATUS, "monitors": MONITORS, "margins": MARGINS}.items():
        said(feed, key, payload)
    said(feed, "events", violation(7))
    holding = {"name": "phase", "severity": "error", "data": {"to": "hold"}, "time_s": 1.79e9}
    said(feed, "events", {**holding, "text": "holding: the daemon lost its way"})
    said(feed, "seen_space", SEEN_SPACE)
    text = rendered(feed, 1_790_000_000.1)
    for words in (
        "AVOID",
        "12.00, 0.50, -4.00",
        "0.310 m",
        "not known",
        "-0.10 m",
        "event 7",
        "3 frames malformed",
        "nothing better certifies",
        "34.0 m away",
        "17 %",
        "the daemon lost its way",
    ):
        assert words in text
    assert "no contact" not in text
    assert "before departure" not in text
    assert "no contact for 9 s" in rendered(feed, 1_790_000_009.0)
    said(feed, "status", {**STATUS, "phase": "standby", "cleared": False})
    text = rendered(feed, 1_790_000_000.1)
    assert "before departure" in text
    assert "require_preflight" in text


def test_the_terminal_shows_what_moves_and_for_what_the_vehicle_yields() -> None:
    feed = Feed()
    said(feed, "status", {**STATUS, "phase": "yield"})
    assert "what moves" not in rendered(feed, 1_790_000_000.1)
    said(feed, "seen_space", {**SEEN_SPACE, "pause": "yielding: mover ring/1 may be on the way"})
    said(feed, "movers", MOVERS)
    text = rendered(feed, 1_790_000_000.1)
    for words in (
        "YIELD: mover ring/1 may be on the way",
        "no place is known to hold no mover: 1 of 3 frames have counted",
        "ring/1", "person", "2.8 m away or more", "seen 0.1 s ago", "at most 1.0 m/s",
        "yields for it", "and 2 more, farther away",
    ):  # fmt: skip
        assert words in text
    assert "pausing" not in text
    # A silent sensor: it may have come nearer since.
    said(feed, "status", {**STATUS, "phase": "yield", "time_s": 1_790_000_001.0})
    assert "1.8 m away or more" in rendered(feed, 1_790_000_001.1)
    said(feed, "movers", {"time_s": 1_790_000_001.0})
    assert "none is seen" in rendered(feed, 1_790_000_001.1)


# ---------------------------------------------------------------------------- in a browser

OBSTACLE = {
    "id": "front/1",
    "measured_ned_m": [[15, 0], [16, 0], [16, 1], [15, 1]],
    "keep_out_ned_m": [[14, -1], [17, -1], [17, 2], [14, 2]],
    "region_ned_m": [[10, -3], [20, -3], [20, 4], [10, 4]],
    "lane_ned_m": [[10, -2], [20, -2], [20, 3], [10, 3]],
    "boundary_ned_m": [[14, -1], [12, 0.5], [14, 2]],
}


def text_of(page: Page, element: str) -> str:
    text: str = page.evaluate(f"document.getElementById('{element}').textContent")
    return text


def north_m(page: Page) -> float:
    """Where the map shows the vehicle."""
    transform = page.evaluate("document.getElementById('vehicle')?.getAttribute('transform') ?? ''")
    return float(transform.partition("(")[2].partition(" ")[0] or "nan")


def test_the_page_shows_everything_that_is_said(tmp_path: Path) -> None:
    feed = Feed()
    said(feed, "status", {**STATUS, "phase": "cruise", "position_ned_m": [11.0, 0.5, -4.0]})
    with chromium(tmp_path / "profile") as page, serving(feed, "v1", "127.0.0.1", 0) as url:
        page.look_like(1280, 900)
        page.open(url)
        for key, payload in {
            "map": {"time_s": 0.0, "obstacles": [OBSTACLE]},
            "plan": {
                "time_s": 0.0,
                "obstacle": "front/1",
                "side": "left",
                "path_ned_m": [[11, 0.5, -4], [14, 2.2, -4]],
            },
            "seen_space": SEEN_SPACE,
            "monitors": MONITORS,
            "margins": MARGINS,
            "events": {**violation(7), "text": "<b>not markup</b>"},
            "status": STATUS,
        }.items():
            said(feed, key, payload)
        page.until("document.getElementById('phase').textContent === 'AVOID'")
        page.until("document.getElementById('events').rows.length === 1")
        assert north_m(page) == 12.0
        drawn = page.evaluate("document.querySelector('#map .flown').getAttribute('d')")
        assert drawn == "M11 0.5L12 0.5"
        assert page.evaluate("document.querySelector('#map .plan').getAttribute('d')") == (
            "M11 0.5L14 2.2"
        )
        assert page.evaluate("document.querySelectorAll('#map .region').length") == 1
        free = "document.querySelector('#map .seen-free')"
        assert page.evaluate(f"{free}.getAttribute('d')") == "M0 0h0.5v2h-0.5ZM0.5 1h0.5v1h-0.5Z"
        assert page.evaluate(f"{free}.getAttribute('transform')") == "translate(9 -2) rotate(90)"
        way = "document.querySelector('#map .way-to-rest').getAttribute('d')"
        assert page.evaluate(way) == "M12 0.5L13 0.5"
        assert page.evaluate("document.querySelector('#map .guide').getAttribute('d')")
        # What the contract declares is drawn: 90 degrees wide, 10 m far.
        feed.declare(CONTRACT)
        said(feed, "status", STATUS)
        page.until("document.querySelector('#map .cone')?.getAttribute('d')")
        cone = page.evaluate("document.querySelector('#map .cone').getAttribute('d')")
        range_m, half_rad = (
            CONTRACT.sensor.detection_range_m,
            math.radians(CONTRACT.sensor.field_of_view_deg) / 2.0,
        )
        corner = [float(number) for number in re.findall(r"[-\d.]+", cone)[2:4]]
        assert corner == pytest.approx(
            [range_m * math.cos(half_rad), -range_m * math.sin(half_rad)], abs=1e-3
        )
        radius = "document.querySelector('#vehicle circle').getAttribute('r')"
        assert float(page.evaluate(radius)) == CONTRACT.vehicle.radius_m
        goal = page.evaluate("document.querySelector('#map .goal').getAttribute('transform')")
        assert goal.startswith("translate(46 0) ")
        assert "goal 34.0 m away" in text_of(page, "readout")
        assert re.fullmatch(
            r"[125]0* m", page.evaluate("document.querySelector('#map .scale text').textContent")
        )
        assert text_of(page, "battery") == "battery 17 %"
        assert page.evaluate("document.getElementById('battery').className") == "bad"
        assert text_of(page, "reason") == "front/1, left"
        assert text_of(page, "pause") == "pausing: nothing better certifies"
        assert (
            page.evaluate("document.querySelector('#monitors .bad').textContent")
            == "0.31 of 0.25 m"
        )
        assert page.evaluate("document.querySelector('#margins .bad').textContent") == "-0.10 m"
        assert "<b>not markup</b>" in text_of(page, "events")
        page.until("document.getElementById('contact').textContent.startsWith('no contact')")
        assert page.complaints == []


def test_the_page_says_what_is_missing_and_why_the_vehicle_holds(tmp_path: Path) -> None:
    feed = Feed()
    waiting = {**STATUS, "phase": "standby", "mode": "POSCTL", "cleared": False, "time_s": 1.79e9}
    said(feed, "status", waiting)
    with chromium(tmp_path / "profile") as page, serving(feed, "v1", "127.0.0.1", 0) as url:
        page.look_like(390, 844, theme="dark")
        page.open(url)
        page.until("document.querySelectorAll('#missing li').length > 1")
        assert page.evaluate("document.getElementById('departure').hidden") is False
        missing = text_of(page, "missing")
        assert "authorization: require_preflight: no recent check has passed" in missing
        assert "clearway preflight" in missing
        assert " more)" in text_of(page, "reason")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        # However far the goal is, the vehicle is to be seen.
        arrow = "document.querySelector('#vehicle .arrow').getBoundingClientRect().width"
        assert page.evaluate(arrow) >= 12.0
        holding = {"name": "phase", "severity": "error", "data": {"to": "hold"}, "time_s": 1.79e9}
        said(feed, "events", {**holding, "text": "holding: tracking_error: 0.4, limit 0.35 m"})
        said(feed, "status", {**waiting, "phase": "hold"})
        page.until("document.getElementById('phase').textContent === 'HOLD'")
        assert text_of(page, "reason") == "tracking_error: 0.4, limit 0.35 m"
        page.until("document.getElementById('departure').hidden")
        assert page.complaints == []


def test_the_page_shows_what_moves_and_for_what_the_vehicle_yields(tmp_path: Path) -> None:
    feed = Feed()
    yielding = {**STATUS, "phase": "yield"}
    with chromium(tmp_path / "profile") as page, serving(feed, "v1", "127.0.0.1", 0) as url:
        page.look_like(390, 844, theme="dark")
        page.open(url)
        said(feed, "movers", MOVERS)
        said(feed, "status", yielding)
        page.until("document.getElementById('phase').textContent === 'YIELD'")
        assert text_of(page, "reason") == "for ring/1: mover ring/1 may be on the way"
        assert text_of(page, "pause") == ""
        # Seen 0.1 s ago, and as much more for its stamp: 0.2 m on every side.
        box = "document.querySelector('#map .mover.yielded').getAttribute('d')"
        corner = [float(each) for each in re.findall(r"[-\d.]+", page.evaluate(box))[:2]]
        assert corner == pytest.approx([14.8, -0.2])
        reach = "document.querySelector('#map .reach').getAttribute('d')"
        assert page.evaluate(reach) == "M13 -2L18 -2L18 3L13 3Z"
        free = "document.querySelector('#map .mover-free')"
        assert page.evaluate(f"{free}.getAttribute('d')") == "M0 0.5h0.5v1.5h-0.5Z"
        assert page.evaluate(f"{free}.getAttribute('transform')") == "translate(2 -6)"
        assert page.evaluate("document.querySelector('#map .mover-name').textContent") == "person"
        assert "2.8 m0.1 s ago1.0 m/syields for it" in text_of(page, "movers")
        assert "and 2 more" in text_of(page, "movers")
        assert "1 of 3 frames have counted" in text_of(page, "movers-missing")
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert not page.evaluate("document.querySelector('.movers-legend').hidden")
        # Between its sightings it grows.
        said(feed, "status", {**yielding, "time_s": 1_790_000_001.0})
        page.until("document.getElementById('movers').textContent.includes('1.8 m1.1 s ago')")
        said(feed, "movers", {"time_s": 1_790_000_001.0})
        said(feed, "status", {**STATUS, "phase": "cruise"})
        page.until("document.getElementById('movers').textContent.includes('none is seen')")
        assert page.evaluate("document.querySelectorAll('#map .mover, #map .reach').length") == 0
        assert page.complaints == []


# ---------------------------------------------------------------------------- live


@contextmanager
def running(*arguments: str, stdout: int = subprocess.PIPE) -> Iterator[subprocess.Popen[str]]:
    """Start a command and have it stopped afterwards, whatever the test does."""
    process = subprocess.Popen(
        [sys.executable, "-m", "gcs_tools", *arguments],
        stdout=stdout, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip
    with process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.communicate(timeout=60.0)


@pytest.mark.real_time
def test_the_page_follows_a_flight_until_it_is_interrupted(tmp_path: Path) -> None:
    out = tmp_path / "flight"
    onboard = out / "onboard.yaml"
    with chromium(tmp_path / "profile") as page, running("fly", "--out", str(out)) as flight:
        until(onboard.exists, timeout_s=60.0)
        with running("watch", "--daemon-config", str(onboard), "--port", "0") as watching:
            assert watching.stdout is not None
            page.look_like(1280, 900)
            page.open(watching.stdout.readline().strip())
            page.until("document.getElementById('phase').textContent === 'CRUISE'")
            began_m = north_m(page)
            page.until(f"Number(readout.textContent.match(/north (\\S+)/)[1]) > {began_m + 1.0}")
            assert north_m(page) > began_m + 0.9
            assert page.evaluate("document.querySelectorAll('#map .obstacle').length") >= 1
            assert page.evaluate("document.querySelectorAll('#margins tr').length") >= 5
            assert "tracking error" in text_of(page, "monitors")
            assert "cruise (control granted)" in text_of(page, "events")
            words = ("OFFBOARD", "m north, east, down", "limit 0.200 m", "separation")
            with terminal() as screen:
                command = ("watch", "--daemon-config", str(onboard), "--tui")
                with running(*command, stdout=screen.written_to):
                    until(lambda: all(any(w in line for line in screen.lines) for w in words))
            started = children_of(flight.pid)
            flight.send_signal(signal.SIGINT)
            page.until("document.getElementById('contact').textContent.startsWith('no contact')")
            assert page.complaints == []
            watching.send_signal(signal.SIGINT)
            _, err = watching.communicate(timeout=60.0)
            assert (watching.returncode, err) == (0, "")
        _, err = flight.communicate(timeout=60.0)
    # Ctrl-C leaves nothing running.
    assert (flight.returncode, err) == (128 + signal.SIGINT, "clearway: error: interrupted\n")
    assert set(started) == {"sitl", "onboard"}
    assert not any(is_alive(pid) for pid in started.values())
    # Both were asked to stop, not killed: their logs are complete.
    assert all(read_log(out / name).complete for name in ("flight.mcap", "truth.mcap"))
