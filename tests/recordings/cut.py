"""Cuts the excerpts of the tests out of the whole recordings.

    python -m tests.recordings.cut DIRECTORY [EXCERPTS]

DIRECTORY holds the recordings.  An excerpt keeps the seconds that `flights` names and the messages
that the service reads or could ask for, attitude at most at the 50 Hz that it asks for; of the
flight log beside a recording it keeps the hulls.  What is not of the recording is added here and
nowhere else, see `synthetic_ardupilot_gps`.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink import COMPONENT_ID
from tests.recordings.flights import EXCERPTS, FLIGHTS, Flight
from tests.recordings.sightings import hulls_of_log, write_hulls
from tests.recordings.tlog import Entry, read_tlog, write_tlog

SIZE_MAX_BYTES = 300_000
_ATTITUDE_PERIOD_S = 0.015
_KEPT = frozenset(
    (
        mavlink.MAVLINK_MSG_ID_HEARTBEAT,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED,
        mavlink.MAVLINK_MSG_ID_SYS_STATUS,
        mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_STATUSTEXT,
        mavlink.MAVLINK_MSG_ID_COMMAND_ACK,
        mavlink.MAVLINK_MSG_ID_HOME_POSITION,
        mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN,
    )
)

# ArduPilot reports a fix only when a new one has come, and none once a GPS has been silent for 4 s
# (then every second); the EKF stops calling its position absolute 7 s after the last fix.
_GPS_PERIOD_S, _EKF_PERIOD_S, _NO_GPS_PERIOD_S = 0.2, 0.2, 1.0
_GPS_TIMEOUT_S, _EKF_TIMEOUT_S = 4.0, 7.0
_FIX_3D, _NO_GPS = 3, 0
# Attitude, velocities, heights, position relative and absolute, and their predictions.
_EKF_WHOLE, _EKF_NO_POSITION = 831, 167


def excerpt(flight: Flight, path: Path) -> list[Entry]:
    """Return the entries of a recording that its excerpt keeps, synthetic ones among them."""
    entries = list(read_tlog(path))
    begin_s, end_s = (entries[0].time_unix_s + at_s for at_s in flight.window_s)
    kept = [entry for entry in entries if begin_s <= entry.time_unix_s <= end_s]
    kept = list(_thinned(entry for entry in kept if entry.message_id in _KEPT))
    if flight.gps_lost_s is not None:
        lost_s = entries[0].time_unix_s + flight.gps_lost_s
        kept += synthetic_ardupilot_gps(begin_s, lost_s, end_s)
    return sorted(kept, key=lambda entry: entry.time_unix_s)


def _thinned(entries: Iterator[Entry]) -> Iterator[Entry]:
    attitude_s = -math.inf
    for entry in entries:
        if entry.message_id == mavlink.MAVLINK_MSG_ID_ATTITUDE:
            if entry.time_unix_s - attitude_s < _ATTITUDE_PERIOD_S:
                continue
            attitude_s = entry.time_unix_s
        if entry.sender[1] == COMPONENT_ID and entry.message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            continue
        yield entry


def synthetic_ardupilot_gps(begin_s: float, lost_s: float, end_s: float) -> Iterator[Entry]:
    """Yield GPS_RAW_INT and EKF_STATUS_REPORT as ArduPilot sends them around a loss of GPS.

    Args:
        begin_s, end_s: Unix times of the first and of the last.
        lost_s: Unix time of the last fix.
    """
    codec = mavlink.MAVLink(None, 1, 1)

    def entry(time_s: float, message: mavlink.MAVLink_message) -> Entry:
        return Entry(time_s, bytes(message.pack(codec)))

    for time_s in _times(begin_s, lost_s, _GPS_PERIOD_S):
        yield entry(time_s, _gps(time_s, _FIX_3D, 10))
    for time_s in _times(lost_s + _GPS_TIMEOUT_S, end_s, _NO_GPS_PERIOD_S):
        yield entry(time_s, _gps(lost_s, _NO_GPS, 0))
    for time_s in _times(begin_s + 0.05, end_s, _EKF_PERIOD_S):
        lost = time_s >= lost_s + _EKF_TIMEOUT_S
        flags = _EKF_NO_POSITION if lost else _EKF_WHOLE
        # Without measurements there is nothing to test: the ratios stay, until the failsafe.
        variances = (1.0, 1.0, 0.05, 0.05, 0.0) if lost else (0.05, 0.03, 0.02, 0.05, 0.0)
        yield entry(time_s, mavlink.MAVLink_ekf_status_report_message(flags, *variances))


def _gps(fix_s: float, fix_type: int, satellites: int) -> mavlink.MAVLink_message:
    error_cm, unknown = (121, 65535) if fix_type else (9999, 65535)
    return mavlink.MAVLink_gps_raw_int_message(
        round(fix_s * 1e6) % 2**40, fix_type, 0, 0, 0, error_cm, error_cm, 0, unknown, satellites
    )


def _times(begin_s: float, end_s: float, period_s: float) -> Iterator[float]:
    for number in range(max(math.ceil((end_s - begin_s) / period_s), 0)):
        yield begin_s + number * period_s


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="Cut the tests' excerpts out of the recordings.")
    parser.add_argument("recordings", type=Path, metavar="DIRECTORY")
    parser.add_argument("excerpts", type=Path, nargs="?", default=EXCERPTS)
    options = parser.parse_args(arguments)
    options.excerpts.mkdir(parents=True, exist_ok=True)
    for flight in FLIGHTS.values():
        source, target = (d / f"{flight.name}.tlog" for d in (options.recordings, options.excerpts))
        try:
            write_tlog(target, excerpt(flight, source))
        except OSError as error:
            print(f"{error.filename}: {error.strerror}", file=sys.stderr)
            return 2
        log = source.with_suffix(".mcap")
        if log.exists():
            write_hulls(target.with_name(f"{flight.name}.hulls.json"), hulls_of_log(log))
        size_bytes = target.stat().st_size
        print(f"{target.name}: {size_bytes} bytes")
        if size_bytes > SIZE_MAX_BYTES:
            print(f"{target.name}: {size_bytes} bytes, at most {SIZE_MAX_BYTES}", file=sys.stderr)
            return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
