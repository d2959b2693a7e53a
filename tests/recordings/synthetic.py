"""What ArduPilot says of its position, for recordings that were made without asking for it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.recordings.tlog import Decoder, Entry

# ArduPilot reports a fix only when a new one has come, and none once a GPS has been silent for 4 s
# (then every second); the EKF stops calling its position absolute 7 s after the last fix.
_GPS_PERIOD_S, _EKF_PERIOD_S, _NO_GPS_PERIOD_S = 0.2, 0.2, 1.0
_GPS_TIMEOUT_S, _EKF_TIMEOUT_S = 4.0, 7.0
_FIX_3D, _NO_GPS = 3, 0
# Attitude, velocities, heights, position relative and absolute, and their predictions.
_EKF_WHOLE, _EKF_NO_POSITION = 831, 167


def with_ardupilot_gps(
    entries: list[Entry], begin_unix_s: float, lost_s: float | None
) -> list[Entry]:
    """Return the entries of a recording, with those that ArduPilot was not asked for.

    Recordings of other autopilots, and those that have GPS_RAW_INT, stay as they are.

    Args:
        entries: of the recording, or of a part of it.
        begin_unix_s: of the recording.
        lost_s: when the GPS is lost, from there; None if it is not.
    """
    if not _lacks_gps(entries):
        return entries
    first_s, last_s = entries[0].time_unix_s, entries[-1].time_unix_s
    gone_s = math.inf if lost_s is None else begin_unix_s + lost_s
    added = synthetic_ardupilot_gps(first_s, gone_s, last_s)
    return sorted((*entries, *added), key=lambda entry: entry.time_unix_s)


def _lacks_gps(entries: list[Entry]) -> bool:
    decoder = Decoder()
    kinds = {entry.message_id for entry in entries}
    return mavlink.MAVLINK_MSG_ID_GPS_RAW_INT not in kinds and any(
        message.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
        for entry in entries
        if entry.message_id == mavlink.MAVLINK_MSG_ID_HEARTBEAT
        and (message := decoder.decode(entry)) is not None
    )


def synthetic_ardupilot_gps(begin_s: float, lost_s: float, end_s: float) -> Iterator[Entry]:
    """Yield GPS_RAW_INT and EKF_STATUS_REPORT as ArduPilot sends them around a loss of GPS.

    Args:
        begin_s, end_s: Unix times of the first and of the last.
        lost_s: Unix time of the last fix.
    """
    codec = mavlink.MAVLink(None, 1, 1)

    def entry(time_s: float, message: mavlink.MAVLink_message) -> Entry:
        return Entry(time_s, bytes(message.pack(codec)))

    for time_s in _times(begin_s, min(lost_s, end_s), _GPS_PERIOD_S):
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
    if begin_s >= end_s:
        return
    for number in range(math.ceil((end_s - begin_s) / period_s)):
        yield begin_s + number * period_s
