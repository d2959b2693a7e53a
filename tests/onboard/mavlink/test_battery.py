"""What the autopilot says of its batteries."""

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from onboard.mavlink.battery import BatteryReports
from onboard.mavlink.endpoint import MavlinkEndpoint

SILENCE_S = 5.0


def battery(percent: int, number: int = 0) -> mavlink.MAVLink_battery_status_message:
    return mavlink.MAVLink_battery_status_message(
        number, 0, 0, 2500, [15000, *(0xFFFF,) * 9], 1200, 300, -1, percent
    )


def system(percent: int) -> mavlink.MAVLink_sys_status_message:
    return mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 15000, 1200, percent, *(0,) * 6)


def test_nothing_is_known_before_a_report_and_after_a_silence() -> None:
    reports = BatteryReports()
    assert reports.charge(0.0, SILENCE_S) is None
    reports.hear_battery(battery(80), 1.0)
    assert reports.charge(6.0, SILENCE_S) == 0.8
    assert reports.charge(6.01, SILENCE_S) is None


@pytest.mark.parametrize("percent", [-1, -128, 101, 127])
def test_a_charge_that_is_none_says_nothing(percent: int) -> None:
    reports = BatteryReports()
    reports.hear_battery(battery(percent), 1.0)
    reports.hear_system(system(percent), 1.0)
    assert reports.charge(1.0, SILENCE_S) is None


def test_the_emptiest_battery_counts_and_one_that_is_silent_is_unknown() -> None:
    reports = BatteryReports()
    reports.hear_battery(battery(80, 0), 1.0)
    reports.hear_battery(battery(60, 1), 1.0)
    assert reports.charge(1.0, SILENCE_S) == 0.6
    reports.hear_battery(battery(59, 1), 7.0)
    assert reports.charge(7.0, SILENCE_S) is None


def test_in_flight_a_charge_does_not_rise() -> None:
    reports = BatteryReports()
    reports.hear_battery(battery(30), 1.0)
    reports.hear_battery(battery(100), 2.0)
    assert reports.charge(2.0, SILENCE_S) == 1.0
    reports.in_flight = True
    reports.hear_battery(battery(70), 3.0)
    reports.hear_battery(battery(74), 4.0)
    assert reports.charge(4.0, SILENCE_S) == 0.7


def test_the_first_battery_counts_only_where_none_is_reported_by_itself() -> None:
    reports = BatteryReports()
    reports.hear_system(system(40), 1.0)
    assert reports.charge(1.0, SILENCE_S) == 0.4
    reports.hear_battery(battery(80), 1.0)
    assert reports.charge(1.0, SILENCE_S) == 0.8


def test_a_broken_sender_does_not_fill_the_memory() -> None:
    reports = BatteryReports()
    for number in range(200):
        reports.hear_battery(battery(100 - number // 2, number), 1.0)
    assert reports.charge(1.0, SILENCE_S) == pytest.approx(0.93)


def test_the_endpoint_requests_and_hears_it_where_it_is_wanted() -> None:
    link, autopilot = MavlinkEndpoint(1), mavlink.MAVLink(None, 1, 1)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)

    def requested() -> set[int]:
        link.receive(heartbeat.pack(autopilot), 0.0)
        link.keep_alive(0.0, active=False)
        sent = mavlink.MAVLink(None, 1, 1).parse_buffer(link.bytes_to_send()) or []
        return {int(each.param1) for each in sent if each.get_type() == "COMMAND_LONG"}

    assert mavlink.MAVLINK_MSG_ID_BATTERY_STATUS not in requested()
    link = MavlinkEndpoint(1)
    link.wants_battery = True
    assert mavlink.MAVLINK_MSG_ID_BATTERY_STATUS in requested()
    link.receive(battery(66).pack(autopilot), 1.0)
    assert link.battery.charge(1.0, SILENCE_S) == 0.66
