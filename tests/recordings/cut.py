"""Cuts the excerpts of the tests out of the whole recordings.

    python -m tests.recordings.cut DIRECTORY [EXCERPTS]

DIRECTORY holds the recordings.  An excerpt keeps the seconds that `flights` names and the messages
that the service reads or could ask for, attitude at most at the 50 Hz that it asks for; of the
flight log beside a recording it keeps the hulls.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterator
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.transmitter import COMPONENT_ID
from tests.recordings.flights import EXCERPTS, FLIGHTS, Flight
from tests.recordings.sightings import hulls_of_log, write_hulls
from tests.recordings.synthetic import with_ardupilot_gps
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


def excerpt(flight: Flight, path: Path) -> list[Entry]:
    """Return the entries of a recording that its excerpt keeps, synthetic ones among them."""
    entries = list(read_tlog(path))
    begin_s, end_s = (entries[0].time_unix_s + at_s for at_s in flight.window_s)
    kept = [entry for entry in entries if begin_s <= entry.time_unix_s <= end_s]
    kept = list(_thinned(entry for entry in kept if entry.message_id in _KEPT))
    return with_ardupilot_gps(kept, entries[0].time_unix_s, flight.gps_lost_s)


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
