"""``clearway fly``: flies a scenario file, logs the flight and evaluates it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from gcs_tools.console.errors import CommandError
from gcs_tools.console.progress import FlightProgress, Report, progress_bar
from gcs_tools.flight_report.command import write_report
from gcs_tools.flight_report.document import document_of
from gcs_tools.flight_report.flight import Flight
from gcs_tools.logs.flight_log import FOXGLOVE_SUFFIX, Log, read_log
from gcs_tools.logs.result import Result, result_of
from gcs_tools.preflight import command as preflight
from gcs_tools.preflight.command import Preflight
from gcs_tools.preflight.tier import Tier
from gcs_tools.scenario import Scenario, load_scenario
from onboard.authentication.key_file import load_key
from onboard.files.contract_file import Contract

if TYPE_CHECKING:
    from sitl.virtual.simulation import SimulatedFlight

DEFAULT_SCENARIO = Path(__file__).parent / "example" / "paper.yaml"
# Of a flight, and what `clearway export` has made of it.
_OUTPUT_FILES = (
    "flight.mcap",
    "flight.tlog",
    f"flight{FOXGLOVE_SUFFIX}",
    "truth.mcap",
    "result.json",
    "flight.png",
    "report.html",
    "progress.json",
)
_COLOURS = {"arrived": "green", "held": "yellow", "collided": "red", "aborted": "red"}


def fly(
    path: Path | None,
    *,
    virtual: bool,
    seed: int,
    out: Path | None,
    fly_outside_contract: bool,
    accept_no_progress: bool = False,
    clearance_wish_m: float | None = None,
    mavlink_key_file: Path | None = None,
) -> bool:
    """Fly a scenario; return whether the mission succeeded without collision or violation.

    The scenario's expectation is reported, but not returned.  Logs, ``result.json``, picture and
    report replace those of an earlier flight.

    Args:
        path: the scenario; None for the paper's example.
        virtual: in virtual time, in this process.
        seed: of the simulation's random numbers.
        out: output directory; None for ``flights/<scenario>-<seed>``.
        fly_outside_contract: fly even if the pre-flight check refuses.
        accept_no_progress: fly by ``requirements.progress: best_effort``.
        clearance_wish_m: in place of ``vehicle.clearance_wish_m``.
        mavlink_key_file: of all that sign, but for a vehicle with a key of the scenario.

    Raises:
        FileError: the scenario or one of its files cannot be used.
        CommandError: the flight could not begin, or was interrupted.
    """
    scenario = load_scenario(path or DEFAULT_SCENARIO)
    contract = _wishing(scenario.contract, clearance_wish_m)
    scenario = replace(scenario, contract=best_effort(contract) if accept_no_progress else contract)
    console = Console(highlight=False)
    outside = fly_outside_contract or scenario.fly_outside_contract
    if not _may_fly(_checked(scenario), outside, console):
        return False
    key = _key_for(scenario, mavlink_key_file, virtual=virtual)
    directory = _prepared(out or Path("flights") / f"{scenario.name}-{seed}")
    fly_it = partial(_fly_virtual, console) if virtual else _fly_live
    result, logs = fly_it(scenario, seed, directory, outside, key)
    _write(scenario, logs, result, directory)
    _print_summary(scenario, result, directory, console)
    return result.succeeded


def _key_for(scenario: Scenario, path: Path | None, *, virtual: bool) -> bytes | None:
    """Return the key of daemon and operator, if the flight is one that can be flown.

    Raises:
        FileError: the file cannot be used.
        CommandError: a live flight has faults, or its vehicle signs and no key is given.
    """
    if scenario.faults and not virtual:
        raise CommandError(f"{scenario.name}: faults need virtual time: use --virtual")
    if path is not None:
        return load_key(path)
    if not virtual and (scenario.plant.signing_passphrase or scenario.plant.signing_key_hex):
        raise CommandError(
            f"{scenario.name}: the vehicle signs, and would refuse what is not signed: state "
            "--mavlink-key F, the vehicle's key"
        )
    return None


def _checked(scenario: Scenario) -> Preflight:
    known = scenario.obstacles if scenario.field_known else None
    return preflight.check(scenario.contract, known, scenario.mission)


def _write(scenario: Scenario, logs: tuple[Log, Log], result: Result, directory: Path) -> None:
    """Write result, picture and report beside the logs."""
    result.write(directory / "result.json")
    _draw(scenario, logs, result, directory / "flight.png")
    if logs[0].states:  # a daemon that died at once left no state
        document = document_of(Flight(directory.name, *logs, result=asdict(result)))
        write_report([document], directory / "report.html")


def best_effort(contract: Contract) -> Contract:
    """Return a contract that accepts that arrival is not guaranteed."""
    requirements = contract.requirements.model_copy(update={"progress": "best_effort"})
    return contract.model_copy(update={"requirements": requirements})


def _wishing(contract: Contract, clearance_wish_m: float | None) -> Contract:
    """Return a contract that prefers a distance to obstacles; None leaves it as it is."""
    if clearance_wish_m is None:
        return contract
    vehicle = contract.vehicle.model_copy(update={"clearance_wish_m": clearance_wish_m})
    return contract.model_copy(update={"vehicle": vehicle})


def _may_fly(checked: Preflight, fly_outside_contract: bool, console: Console) -> bool:
    if checked.tier is Tier.PROGRESS_GUARANTEED:
        console.print(f"pre-flight check: [green]{checked.tier.value}[/]")
        return True
    permitted = checked.may_fly or fly_outside_contract
    how = "accepted" if checked.may_fly else "flying outside the contract"
    verdict = f"[yellow]{checked.tier.value}[/], {how if permitted else '[red]refused[/]'}"
    console.print(f"pre-flight check: {verdict}")
    for refusal in checked.refusals:
        console.print(f"  • {refusal}", markup=False, soft_wrap=True)
    if not permitted and checked.tier is Tier.SAFE:
        console.print("--accept-no-progress flies it without a guarantee to arrive")
    return permitted


def _prepared(directory: Path) -> Path:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name in _OUTPUT_FILES:
            (directory / name).unlink(missing_ok=True)
    except OSError as error:
        raise CommandError(f"{directory}: cannot be written: {error.strerror or error}") from error
    return directory


def _fly_live(
    scenario: Scenario,
    seed: int,
    directory: Path,
    fly_outside_contract: bool,
    mavlink_key: bytes | None,
) -> tuple[Result, tuple[Log, Log]]:
    # Loads MAVSDK and Zenoh, which a virtual flight does not need.
    from gcs_tools.fly.live_flight import fly_live  # noqa: PLC0415  loads MAVSDK

    with _progress(scenario, "preparing") as report:
        aborted = fly_live(
            scenario,
            seed=seed,
            out=directory,
            fly_outside_contract=fly_outside_contract,
            report=report,
            mavlink_key=mavlink_key,
        )
    flight, truth = _logs(directory)
    progress = scenario.contract.requirements.progress
    return result_of(flight, truth, seed=seed, aborted=aborted, progress=progress), (flight, truth)


def _fly_virtual(
    console: Console,
    scenario: Scenario,
    seed: int,
    directory: Path,
    fly_outside_contract: bool,
    mavlink_key: bytes | None,
) -> tuple[Result, tuple[Log, Log]]:
    # A live flight runs the simulation in another process; only a virtual one loads it here.
    from sitl.autopilot.flavours.parameters import ParameterError  # noqa: PLC0415  simulator
    from sitl.virtual.simulation import Simulation, fly  # noqa: PLC0415  loads the simulator

    planned = _planned(scenario, seed, mavlink_key, outside=fly_outside_contract)
    try:
        with _progress(scenario, "flying in virtual time") as show:

            def watch(simulation: Simulation) -> None:
                vehicle, phase = simulation.scene.vehicle, simulation.autonomy.navigator.phase
                show(f"{phase.value:<7} {simulation.now_s:5.0f} s", vehicle.truth.position_ned_m)

            report = fly(planned, directory, watch)
    except (OSError, ParameterError) as error:
        raise CommandError(f"{directory}: {error}") from error
    ratio = report.virtual_s / report.wall_s
    seconds = f"{report.virtual_s:.0f} s flown in {report.wall_s:.1f} s"
    console.print(f"{seconds} ({ratio:.0f} times real time)")
    flight, truth = _logs(directory)
    result = result_of(
        flight,
        truth,
        seed=seed,
        aborted=report.aborted,
        plan_times_s=report.plan_times_s,
        progress=scenario.contract.requirements.progress,
    )
    return result, (flight, truth)


def _planned(
    scenario: Scenario, seed: int, mavlink_key: bytes | None, *, outside: bool
) -> SimulatedFlight:
    from sitl.virtual.simulation import SimulatedFlight  # noqa: PLC0415  loads the simulator

    return SimulatedFlight(
        contract=scenario.contract,
        mission=scenario.mission,
        sitl=scenario.sitl_config(seed=seed, **_vehicle_key(scenario, mavlink_key)),
        obstacles=scenario.obstacles,
        seed=seed,
        faults=scenario.faults,
        sources=scenario.sources,
        fly_outside_contract=outside,
        mavlink_key=mavlink_key,
    )


def _vehicle_key(scenario: Scenario, mavlink_key: bytes | None) -> dict[str, str]:
    """Return the key of a vehicle to which the scenario gives none, as its configuration has it."""
    has_key = scenario.plant.signing_passphrase or scenario.plant.signing_key_hex
    return {} if has_key or mavlink_key is None else {"signing_key_hex": mavlink_key.hex()}


def _logs(directory: Path) -> tuple[Log, Log]:
    return read_log(directory / "flight.mcap"), read_log(directory / "truth.mcap")


@contextmanager
def _progress(scenario: Scenario, text: str) -> Iterator[Report]:
    """Yield a function that updates a progress line; without a terminal it shows nothing."""
    way = FlightProgress(scenario.mission)
    with progress_bar(text, way.total_m) as bar:

        def report(text: str, position_ned_m: Sequence[float] | None = None) -> None:
            if position_ned_m is None:
                bar.show(text=text)
            elif bar.due:
                bar.show(way.travelled_m(position_ned_m), text)

        yield report


def _draw(scenario: Scenario, logs: tuple[Log, Log], result: Result, path: Path) -> None:
    # matplotlib takes a second to import; after the flight nothing waits for it.
    from gcs_tools.fly.picture import draw_flight  # noqa: PLC0415  loads Matplotlib

    try:
        draw_flight(scenario, *logs, result, path)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error


def _print_summary(scenario: Scenario, result: Result, directory: Path, console: Console) -> None:
    console.print(
        f"[bold {_COLOURS[result.outcome]}]{result.outcome.upper()}[/]  {escape(result.reason)}",
        soft_wrap=True,
    )
    table = Table(show_header=False, box=None, padding=(0, 2, 0, 0))
    for name, value in _summary(scenario, result):
        table.add_row(name, value)
    console.print(table)
    for violation in result.violations:
        console.print(f"violated: {violation}", style="red", markup=False, soft_wrap=True)
    expected = "met" if result.meets(scenario.expect) else "NOT met"
    console.print(f"expectation of {scenario.name}: {expected}")
    console.print(f"log, report and picture: {directory}", soft_wrap=True)


def _summary(scenario: Scenario, result: Result) -> Iterator[tuple[str, str]]:
    vehicle = scenario.contract.vehicle
    x_mps, y_mps = result.velocity_error_max_mps
    clearance_m = result.clearance_min_m
    yield "obstacles avoided", str(result.obstacles_avoided)
    yield "collisions", str(result.collisions)
    wish = f" (wish {vehicle.clearance_wish_m:g} m)" if vehicle.clearance_wish_m else ""
    yield "least clearance", "no obstacle" if clearance_m is None else f"{clearance_m:.2f} m{wish}"
    yield "tracking error", f"{result.tracking_error_max_m:.3f} of {vehicle.tracking_error_m} m"
    allowed_x_mps, allowed_y_mps = vehicle.velocity_error_mps
    yield (
        "velocity error",
        f"{x_mps:.3f} of {allowed_x_mps}, {y_mps:.3f} of {allowed_y_mps} m/s",
    )
    yield "plans", ", ".join(f"{count} {kind}" for kind, count in result.plans.items() if count)
    if result.plan_time_ms["max"] is not None:
        times = (f"{name} {ms:.1f}" for name, ms in result.plan_time_ms.items() if ms is not None)
        yield "plan time", ", ".join(times) + " ms"
    yield "mission time", f"{result.duration_s:.1f} s"
    yield "mean speed", f"{result.mean_speed_mps:.2f} m/s"
    if result.pauses:
        yield "pauses", str(result.pauses)
    if result.final_position_ned_m is not None:
        place = ", ".join(f"{value:.1f}" for value in result.final_position_ned_m)
        yield "final position", f"{place} m north, east, down"
