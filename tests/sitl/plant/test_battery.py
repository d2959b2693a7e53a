"""The pack: charge, voltage under load, and the power of the rotors."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.config import MultirotorConfig
from sitl.plant.battery import Battery, BatteryConfig
from sitl.plant.multirotor import hover_speed_rpm, standing_state


def test_battery_drains_by_the_charge_drawn() -> None:
    battery = Battery(BatteryConfig(capacity_ah=2.0, avionics_w=0.0, resistance_ohm=0.0))
    drawn_ah = 0.0
    for _ in range(600):
        battery.drain(150.0, 1.0)
        drawn_ah += battery.reading.current_a / 3600.0
    assert battery.reading.consumed_ah == pytest.approx(
        drawn_ah - battery.reading.current_a / 3600.0
    )
    assert battery.reading.remaining == pytest.approx(1.0 - battery.reading.consumed_ah / 2.0)
    assert battery.reading.voltage_v * battery.reading.current_a == pytest.approx(150.0)


def test_battery_sags_under_load_and_never_goes_below_empty() -> None:
    battery = Battery(BatteryConfig(initial_charge=0.02))
    battery.drain(0.0, 0.0)
    idle_v = battery.reading.voltage_v
    battery.drain(400.0, 0.0)
    assert battery.reading.voltage_v < idle_v - 0.3
    battery.drain(400.0, 3600.0)
    battery.drain(400.0, 1.0)
    assert battery.reading.remaining == 0.0
    assert battery.reading.voltage_v > 0.0


def test_hovering_costs_a_plausible_power() -> None:
    body = MultirotorConfig().parameters()
    state = standing_state(0.0, 0.0, -1.0, 0.0, hover_speed_rpm(body))
    power_w = Battery(BatteryConfig()).drive_power_w(state, body)
    assert 100.0 < power_w < 300.0  # some 8 to 15 W per newton of weight in this class


@given(charge=st.floats(0.0, 1.0), power_w=st.floats(0.0, 800.0))
def test_terminal_voltage_and_current_deliver_the_power(charge: float, power_w: float) -> None:
    config = BatteryConfig(initial_charge=charge)
    battery = Battery(config)
    battery.drain(power_w, 0.0)
    reading = battery.reading
    assert reading.voltage_v * reading.current_a == pytest.approx(power_w + config.avionics_w)
    assert 0.0 < reading.voltage_v <= 4.2 * config.cells


def test_voltage_falls_with_the_charge() -> None:
    voltages_v = [
        Battery(BatteryConfig(initial_charge=step / 50.0)).reading.voltage_v for step in range(51)
    ]
    assert all(low < high for low, high in pairwise(voltages_v))
    assert voltages_v[-1] == pytest.approx(4 * 4.2, abs=0.05)


def test_a_full_pack_reads_full_and_an_initial_charge_is_consumed() -> None:
    assert Battery(BatteryConfig()).reading.remaining == 1.0
    reading = Battery(BatteryConfig(initial_charge=0.25, capacity_ah=4.0)).reading
    assert reading.remaining == pytest.approx(0.25)
    assert reading.consumed_ah == pytest.approx(3.0)


def test_an_overloaded_pack_keeps_half_of_its_open_voltage() -> None:
    battery = Battery(BatteryConfig(resistance_ohm=1.0))
    battery.drain(10_000.0, 1.0)
    assert battery.reading.voltage_v == pytest.approx(4 * 4.2 / 2.0, rel=0.01)
