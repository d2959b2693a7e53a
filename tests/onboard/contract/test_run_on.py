"""Where the vehicle runs on to after a loss of the stream: every state of a slow simulation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from gcs_tools.benchmark.run_on_models import coasting_run_on
from onboard.contract.arithmetic import ARRAY, SCALAR
from onboard.contract.assessment import Terms, assess
from onboard.contract.run_on import contract_run_on, frozen_run_m, overshoot, run_on_slope_s
from onboard.files.contract_file import load_contract
from onboard.geometry.frames import FloatArray
from tests.gcs_tools.running import CONFIG
from tests.onboard.contract.stop_and_sidestep import Coasts, FliesOn
from tests.onboard.contract.test_assessment import as_arrays, contract


def frozen(gain_per_s: float = 0.95, velocity_gain_per_s: float = 1.8) -> dict[str, Any]:
    return {
        "model": "frozen",
        "gain_per_s": gain_per_s,
        "velocity_gain_per_s": velocity_gain_per_s,
    }


def last_states(terms: Terms[float], limits: FloatArray, count: int) -> FloatArray:
    """Setpoints of references that keep speed and jerk: they can still take their jerk back.

    Rows of x, y, speeds and accelerations (N, 6), many of them at a limit.
    """
    random = np.random.default_rng(3)
    accelerations = limits * random.choice((-1.0, 1.0, 0.0, 0.5, -0.5), (count, 2))
    accelerations *= random.choice((1.0, 0.7), (count, 1))
    turn_rad = random.uniform(-math.pi, math.pi, count)
    fastest_mps = terms.cruise_speed_mps * random.choice((1.0, 0.99, 0.5, 0.0), count)
    speeds = fastest_mps[:, np.newaxis] * np.column_stack((np.cos(turn_rad), np.sin(turn_rad)))
    # Start where the acceleration has been taken back, and go back in time to where it was full.
    jerk_mps3 = limits / terms.attitude_lag_s
    before_s = np.abs(accelerations) / jerk_mps3
    back = speeds - accelerations * before_s / 2.0
    keeps = np.ones(count, dtype=bool)
    for share in np.linspace(0.0, 1.0, 21):
        time_s = share * before_s.max(axis=1, keepdims=True)
        short_s = np.minimum(time_s, before_s)
        jerk = np.sign(accelerations) * jerk_mps3
        then = back + accelerations * short_s - jerk * short_s**2 / 2.0
        keeps &= np.hypot(*then.T) <= terms.cruise_speed_mps + 1e-9
    return np.hstack((np.zeros((count, 2)), back, accelerations))[keeps]


def farthest_outside_m(
    places: list[FloatArray], states: FloatArray, gains: tuple[tuple[float, float], ...]
) -> float:
    """Largest distance of any place from the bounding box of the points that bound the run."""
    points = np.array(
        [
            np.zeros_like(states[:, 2:4]),
            *(kappa_s * states[:, 2:4] + c_s2 * states[:, 4:6] for kappa_s, c_s2 in gains),
        ]
    )
    low, high = points.min(axis=0), points.max(axis=0)
    return max(float(np.maximum(low - each, each - high).max()) for each in places)


def limits_of(terms: Terms[float]) -> FloatArray:
    limits = assess(contract(roll_max_deg=math.degrees(terms.roll_max_rad))).limits
    return np.array((limits.brake_mps2, limits.left_mps2))


@pytest.mark.parametrize("timeout_s", [0.05, 0.2, 0.5, 1.0])
@pytest.mark.parametrize("roll_max_deg", [15.0, 25.0])
def test_a_coast_ends_within_its_points(timeout_s: float, roll_max_deg: float) -> None:
    """It may be faster in the end than any setpoint, by what the acceleration still adds."""
    terms = Terms.of(contract(setpoint_loss_timeout_s=timeout_s, roll_max_deg=roll_max_deg))
    limits = limits_of(terms)
    states = last_states(terms, limits, 4000)
    assert len(states) > 1000
    assert np.abs(states[:, 4:6]).max(axis=0) == pytest.approx(limits)
    autopilot = Coasts(timeout_s, terms.attitude_lag_s, float(limits.min()))
    places = [each.copy() for each in autopilot.places_m(states)]
    gains = contract_run_on(terms).gains
    assert farthest_outside_m(places, states, gains) < 5e-3  # steps of 0.01 s
    # What bounds only setpoints without acceleration is left.
    kappa_s = timeout_s + terms.attitude_lag_s + terms.cruise_speed_mps / (2.0 * limits.min())
    if timeout_s >= 0.2:
        short = (*gains[:-1], (kappa_s, timeout_s**2 / 2.0 + timeout_s * kappa_s / 2.0))
        assert farthest_outside_m(places, states, short) > 0.05


@pytest.mark.parametrize(("gain_per_s", "lag_s"), [(0.95, 0.2), (0.95, 0.26), (1.3, 0.15)])
def test_what_flies_on_to_the_last_setpoint_stays_within_its_points(
    gain_per_s: float, lag_s: float
) -> None:
    terms = Terms.of(contract(setpoint_loss=frozen(gain_per_s), attitude_lag_s=lag_s))
    states = last_states(terms, limits_of(terms), 3000)
    autopilot = FliesOn(gain_per_s, 1.8, lag_s)
    places = [each.copy() for each in autopilot.places_m(states)]
    gains = contract_run_on(terms).gains
    assert farthest_outside_m(places, states, gains) < 5e-3
    assert farthest_outside_m(places, states, gains[:1]) > 0.05  # the acceleration counts


@pytest.mark.parametrize(("gain_per_s", "lag_s"), [(1.5, 0.27), (2.0, 0.3), (1.5, 0.4)])
def test_a_loop_that_overshoots_runs_on_no_farther_than_its_overshoot(
    gain_per_s: float, lag_s: float
) -> None:
    """Forward: what is farthest of speeds with no acceleration, and of what speeds up."""
    terms = Terms.of(contract(setpoint_loss=frozen(gain_per_s), attitude_lag_s=lag_s))
    states = np.array([(0, 0, v, 0, a, 0) for v in (0.0, 1.0, 2.8) for a in (0.0, 2.6)], float)
    places = FliesOn(gain_per_s, 1.8, lag_s).places_m(states)
    reached_m = np.max([each[:, 0].copy() for each in places], axis=0)
    (kappa_s, _), *_, (_, c_s2) = contract_run_on(terms).gains
    assert np.all(reached_m <= kappa_s * states[:, 2] + c_s2 * states[:, 4] + 5e-3)
    assert overshoot(gain_per_s, lag_s) > 1.01
    # All of it is needed.
    assert np.all(reached_m[[1, 4]] >= np.array((c_s2 * 2.6, kappa_s * 2.8)) - 0.03)


def test_a_loop_that_is_slow_enough_does_not_overshoot() -> None:
    assert overshoot(0.95, 0.2) == 1.0
    assert overshoot(0.95, 0.0) == 1.0
    assert 1.0 < overshoot(1.5, 0.27) < overshoot(1.5, 0.5) < 2.0


@pytest.mark.parametrize(("lag_s", "velocity_gain_per_s"), [(0.05, 1.8), (0.27, 1.8), (0.3, 9.0)])
def test_the_published_form_counts_on_the_longest_run_of_any_setpoint(
    lag_s: float, velocity_gain_per_s: float
) -> None:
    """Of what flies on: at a the speed is so much less that the acceleration can be taken back."""
    gains = frozen(0.8, velocity_gain_per_s)
    stated = contract(stop=False, setpoint_loss=gains, attitude_lag_s=lag_s)
    limit_mps2, e = assess(stated).limits.forward_mps2, assess(stated).inflated.encounter
    accelerations = np.linspace(0.0, limit_mps2, 4001)
    speeds = e.speed_mps - accelerations**2 * lag_s / (2.0 * limit_mps2)
    (kappa_s, _), (_, c_s2) = contract_run_on(Terms.of(stated)).gains
    assert e.run_on_m == pytest.approx(float((kappa_s * speeds + c_s2 * accelerations).max()))
    # Sideways it is read as coasting for the time that, followed by braking, gives that run.
    coasted_m = e.run_on_m - e.speed_mps**2 / (2.0 * limit_mps2)
    assert e.coast_time_s == pytest.approx(max(0.0, coasted_m / e.speed_mps))


def test_a_coast_of_a_setpoint_whose_jerk_is_not_known() -> None:
    """It may gain all that its acceleration makes of the timeout."""
    limits = {"brake_mps2": 2.0, "speed_max_mps": 3.0, "acceleration_max_mps2": 4.0}
    gains = coasting_run_on(0.5, lag_s=0.1, **limits).gains
    stopping_s = 0.1 + (3.0 + 4.0 * 0.5) / (2.0 * 2.0)
    np.testing.assert_allclose(
        gains, ((0.5, 0.0), (0.5, 0.125), (0.5 + stopping_s, 0.125 + 0.5 * stopping_s))
    )


# --- what was measured on firmware, in metres, at 2.8 m/s

MEASURED_M = {
    "ardupilot": (2.5, 2.9, 3.4),  # cruise, and 0.25 to 2.8 s into an avoidance
    "px4_default_parameters": (3.0, 3.7, 4.3, 4.4, 4.7),
    "px4": (2.97, 3.22),  # cruise; start of an avoidance
}


@pytest.mark.parametrize("name", MEASURED_M)
def test_shipped_contracts_cover_the_runs_that_were_measured(name: str) -> None:
    terms = Terms.of(load_contract(CONFIG / f"{name}_contract.yaml"))
    assert contract_run_on(terms).reach_m(2.8) >= max(MEASURED_M[name])


def test_the_model_of_a_px4_explains_most_of_its_measured_run() -> None:
    """Gain 0.95/s: 3.0 m straight, 4.5 m speeding up; 4.7 m were measured, so that counts."""
    path = CONFIG / "px4_default_parameters_contract.yaml"
    document = load_contract(path).model_dump()
    document["vehicle"]["setpoint_loss_run_on_m"] = None
    model = contract_run_on(Terms.of(type(load_contract(path)).model_validate(document)))
    limit_mps2 = assess(load_contract(path)).limits.forward_mps2
    assert model.reach_m(2.8) == pytest.approx(2.95, abs=0.05)
    *_, (kappa_s, c_s2) = model.gains
    assert kappa_s * 2.8 + c_s2 * limit_mps2 == pytest.approx(4.49, abs=0.05)


# --- which counts


def gains_of(**changes: Any) -> tuple[tuple[float, float], ...]:
    return contract_run_on(Terms.of(contract(**changes))).gains


def test_a_measured_run_replaces_the_model_only_where_it_is_longer() -> None:
    for loss in (None, frozen()):
        model = gains_of(setpoint_loss=loss)
        short = gains_of(setpoint_loss=loss, setpoint_loss_run_on_m=0.5)
        assert short == model
        longer = gains_of(setpoint_loss=loss, setpoint_loss_run_on_m=8.4)
        # Longer for one that speeds up, and the model's own for a setpoint that brakes.
        np.testing.assert_allclose(longer[-3:], ((3.0, 0.0), model[-1], (3.0, model[-1][1])))


def braking_states() -> FloatArray:
    """Setpoints whose acceleration opposes their speed on each axis, (N, 6)."""
    random = np.random.default_rng(5)
    speeds = random.uniform(-2.0, 2.0, (400, 2)) * random.choice((0.0, 0.2, 1.0), (400, 1))
    accelerations = -np.sign(speeds) * random.uniform(0.0, 2.6, (400, 2))
    return np.hstack((np.zeros((400, 2)), speeds, accelerations))


@pytest.mark.parametrize("measured_m", [None, 5.0, 8.4])
@pytest.mark.parametrize(
    ("gain_per_s", "velocity_gain_per_s", "lag_s"),
    [(0.95, 1.8, 0.26), (1.3, 4.5, 0.15), (1.5, 1.8, 0.4), (2.0, 1.8, 0.3), (4.0, 3.0, 0.5)],
)
def test_the_run_of_a_setpoint_that_brakes_stays_within_the_hull(
    gain_per_s: float, velocity_gain_per_s: float, lag_s: float, measured_m: float | None
) -> None:
    """A longer run per speed alone would leave the place where the acceleration leads back."""
    loss = frozen(gain_per_s, velocity_gain_per_s)
    changes: dict[str, Any] = {"setpoint_loss": loss, "attitude_lag_s": lag_s}
    terms = Terms.of(contract(**changes, setpoint_loss_run_on_m=measured_m))
    states, gains = braking_states(), contract_run_on(terms).gains
    autopilot = FliesOn(gain_per_s, velocity_gain_per_s, lag_s)
    places = [each.copy() for each in autopilot.places_m(states)]
    assert farthest_outside_m(places, states, gains) < 8e-3  # steps of 0.01 s
    if measured_m is not None and velocity_gain_per_s < 4.0:
        longest_alone = (gains[0], gains[-1])
        assert farthest_outside_m(places, states, longest_alone) > 0.1


def test_above_its_speed_a_measured_run_is_unknown() -> None:
    faster: dict[str, Any] = {"setpoint_loss_run_on_m": 3.4, "setpoint_loss_run_on_speed_mps": 2.8}
    terms = Terms.of(contract(**faster))
    for speed_mps, known in ((2.8, True), (2.9, False)):
        at_speed = Terms(**{**vars(terms), "cruise_speed_mps": speed_mps})
        assert math.isfinite(contract_run_on(at_speed).gains[-1][0]) is known
        assert math.isfinite(run_on_slope_s(at_speed, SCALAR)) is known


@pytest.mark.parametrize("loss", [None, frozen(), frozen(1.5)])
@pytest.mark.parametrize("measured_m", [None, 5.0])
def test_the_front_counts_on_what_is_certified(
    loss: dict[str, Any] | None, measured_m: float | None
) -> None:
    """One story: the slope of the closed form is the largest of the certifier's points."""
    changes: dict[str, Any] = {"setpoint_loss": loss, "setpoint_loss_run_on_m": measured_m}
    terms = Terms.of(contract(**changes))
    slope_s = max(kappa_s for kappa_s, _ in contract_run_on(terms).gains)
    assert run_on_slope_s(terms, SCALAR) == pytest.approx(slope_s)
    np.testing.assert_allclose(run_on_slope_s(as_arrays(terms, 3), ARRAY), slope_s)


def test_setpoints_that_may_be_faster_run_on_farther_when_they_coast() -> None:
    terms = Terms.of(contract())
    slow, fast = contract_run_on(terms), contract_run_on(terms, 3.5)
    assert fast.gains[-1][0] > slow.gains[-1][0]
    assert contract_run_on(terms, 1.0) == slow


def test_without_passive_safety_nothing_runs_on() -> None:
    terms = Terms.of(contract(passive_safety=False))
    assert contract_run_on(terms).gains == ()
    assert run_on_slope_s(terms, SCALAR) == 0.0


# --- by hand, and by other formulas


def test_a_coast_by_hand() -> None:
    """Half a second of coasting, then braking in any direction, from the speed that it ends at."""
    terms = Terms.of(contract(setpoint_loss_timeout_s=0.5))
    limits, lag_s = limits_of(terms), terms.attitude_lag_s
    # The acceleration is taken back within the lag at the jerk limit, or counts whole.
    gained_s = 0.5 - lag_s + lag_s / 2.0
    fastest_mps = terms.cruise_speed_mps + float(np.hypot(*limits)) * gained_s
    stopping_s = lag_s + fastest_mps / (2.0 * float(limits.min()))
    expected = ((0.5, 0.0), (0.5, 0.125), (0.5 + stopping_s, 0.125 + 0.5 * stopping_s))
    np.testing.assert_allclose(contract_run_on(terms).gains, expected, rtol=1e-6)


@pytest.mark.parametrize(("gain_per_s", "lag_s"), [(1.5, 0.27), (2.0, 0.3), (4.0, 0.5)])
def test_what_a_loop_takes_back_by_its_step_response(gain_per_s: float, lag_s: float) -> None:
    """The largest speed of the first trough over its depth, both read off the step response."""
    terms = Terms.of(contract(setpoint_loss=frozen(gain_per_s), attitude_lag_s=lag_s))
    decay_per_s, natural2 = 1.0 / (2.0 * lag_s), gain_per_s / lag_s
    rate = math.sqrt(natural2 - decay_per_s**2)
    time_s = np.linspace(math.pi, 2.0 * math.pi, 20_001) / rate
    speed_per_s = np.exp(-decay_per_s * time_s) * natural2 / rate * np.sin(rate * time_s)
    lowest = 1.0 - math.exp(-decay_per_s * 2.0 * math.pi / rate)
    share = lag_s * np.abs(speed_per_s).max() / lowest
    *_, (kappa_s, c_s2), (_, farthest_s2) = contract_run_on(terms).gains
    assert c_s2 == farthest_s2
    assert kappa_s == pytest.approx((1.0 - share) * 1.8 * c_s2, rel=1e-6)


def test_a_loop_at_the_limit_of_overshooting_swings_nowhere_back() -> None:
    at_limit = Terms.of(contract(setpoint_loss=frozen(1.0), attitude_lag_s=0.25))
    assert len(contract_run_on(at_limit).gains) == 2
    beyond = Terms.of(contract(setpoint_loss=frozen(1.0), attitude_lag_s=0.26))
    assert len(contract_run_on(beyond).gains) == 3


def test_a_measured_run_covers_diagonal_setpoints_up_to_its_speed_on_each_axis() -> None:
    def known(fastest_mps: float, **measured: Any) -> bool:
        terms = Terms.of(contract(cruise_speed_mps=2.8, **measured))
        return math.isfinite(contract_run_on(terms, fastest_mps).gains[-1][0])

    assert known(20.0)  # without a measured run there is nothing to be above
    own: dict[str, Any] = {"setpoint_loss_run_on_m": 8.4}
    assert known(math.sqrt(2.0) * 2.8, **own)
    assert not known(1.001 * math.sqrt(2.0) * 2.8, **own)
    stated = own | {"setpoint_loss_run_on_speed_mps": 3.5}
    assert known(math.sqrt(2.0) * 3.5, **stated)
    assert not known(1.001 * math.sqrt(2.0) * 3.5, **stated)


def test_the_slope_of_a_measured_run_by_hand() -> None:
    longer: dict[str, Any] = {"cruise_speed_mps": 2.8, "setpoint_loss_run_on_m": 8.4}
    assert run_on_slope_s(Terms.of(contract(**longer)), SCALAR) == pytest.approx(3.0)
    at_its_speed = longer | {"setpoint_loss_run_on_speed_mps": 2.8}
    assert run_on_slope_s(Terms.of(contract(**at_its_speed)), SCALAR) == pytest.approx(3.0)
    faster = longer | {"setpoint_loss_run_on_speed_mps": 3.5}
    assert run_on_slope_s(Terms.of(contract(**faster)), SCALAR) == pytest.approx(2.4)
    without = Terms.of(contract(passive_safety=False, **longer))
    assert run_on_slope_s(without, SCALAR) == 0.0


def test_the_longest_modelled_run_by_hand() -> None:
    """The setpoint either keeps its full acceleration, or as much as can still be taken back."""
    slow = Terms.of(contract(setpoint_loss=frozen(0.8, 9.0), attitude_lag_s=0.3))
    kappa_s, c_s2 = 1.0 / 0.8, 1.0 / (0.8 * 9.0)
    assert kappa_s * 0.3 > c_s2
    part_m = c_s2**2 / (2.0 * kappa_s * 0.3) * 2.0
    assert frozen_run_m(slow, 2.8, 2.0, SCALAR) == pytest.approx(kappa_s * 2.8 + part_m)
    quick = Terms.of(contract(setpoint_loss=frozen(0.8, 1.8), attitude_lag_s=0.05))
    c_s2 = 1.0 / (0.8 * 1.8)
    assert kappa_s * 0.05 < c_s2
    whole_m = (c_s2 - kappa_s * 0.05 / 2.0) * 2.0
    assert frozen_run_m(quick, 2.8, 2.0, SCALAR) == pytest.approx(kappa_s * 2.8 + whole_m)


def with_lag(terms: Terms[float], lag_s: float) -> Terms[float]:
    return Terms(**{**vars(terms), "attitude_lag_s": lag_s})


@pytest.mark.parametrize("lag_s", [0.0, 0.4])
def test_a_coast_shorter_than_the_lag_and_one_without_a_lag_by_hand(lag_s: float) -> None:
    """Of a jerk that takes a lag to act only the timeout counts: t²/2T; without a lag all of t."""
    terms = with_lag(Terms.of(contract(setpoint_loss_timeout_s=0.1)), lag_s)
    limits = limits_of(terms)
    gained_s = 0.1**2 / (2.0 * lag_s) if lag_s else 0.1
    fastest_mps = terms.cruise_speed_mps + float(np.hypot(*limits)) * gained_s
    stopping_s = lag_s + fastest_mps / (2.0 * float(limits.min()))
    assert contract_run_on(terms).gains[-1][0] == pytest.approx(0.1 + stopping_s, rel=1e-6)


def test_without_a_lag_the_last_setpoint_keeps_its_acceleration() -> None:
    terms = with_lag(Terms.of(contract(setpoint_loss=frozen(0.8, 1.8))), 0.0)
    expected_m = 2.8 / 0.8 + 2.0 / (0.8 * 1.8)
    assert frozen_run_m(terms, 2.8, 2.0, SCALAR) == pytest.approx(expected_m)


def test_a_slow_cruise_runs_on_as_at_its_own_speed() -> None:
    slow = Terms(**{**vars(Terms.of(contract())), "cruise_speed_mps": 0.5})
    assert contract_run_on(slow) == contract_run_on(slow, 0.5)
    assert contract_run_on(slow).gains[-1][0] < contract_run_on(slow, 0.9).gains[-1][0]
