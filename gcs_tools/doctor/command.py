"""``clearway status`` and ``clearway doctor``."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Literal

from gcs_tools.console.errors import EXIT_BAD_INPUT, EXIT_NO, CommandError
from gcs_tools.console.keys import mavlink_key
from gcs_tools.doctor.companion import DaemonFiles, diagnose_files, load_daemon_files
from gcs_tools.doctor.diagnosis import Diagnosis, diagnose
from gcs_tools.doctor.observation import Observation, observe
from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.live.bus import bus_of
from onboard.recording.messages import StateRecord, as_json

Form = Literal["text", "json"]
_MARKS = {Verdict.HOLDS: "ok", Verdict.BROKEN: "MISSING", Verdict.UNKNOWN: "UNKNOWN"}


def status(
    config: Path | None, zenoh_config: Path | None, *, form: Form, wait_s: float = 0.0
) -> int:
    """Print what the daemon does; return the exit code.

    0: all is well; 1: something is missing; 2: no daemon was heard.

    Args:
        config: the daemon's own file, on its own computer.
        zenoh_config: how to reach it from another one; None for both scouts.
        form: of the output.
        wait_s: for so long it is asked again until all is well.

    Raises:
        FileError: a file cannot be used.
        CommandError: no Zenoh session.
    """
    bus = bus_of(zenoh_config, config)
    deadline_s = time.monotonic() + wait_s
    while True:
        seen = observe(bus)
        found = diagnose(seen)
        if _exit_code(found) == 0 or time.monotonic() >= deadline_s:
            break
    if form == "json":
        _print_json(found, {"vehicle": bus.vehicle, "status": _fields(seen)})
    elif seen.state is None:
        sys.stdout.write(f"{bus.vehicle}: {found[0].text}: {found[0].cure}\n")
    else:
        for name, text in _status_lines(bus.vehicle, seen.state):
            sys.stdout.write(f"{name:<10} {text}\n")
        for each in found:
            if each.verdict is not Verdict.HOLDS:
                sys.stdout.write(f"{_MARKS[each.verdict]:<10} {each.name}: {each.text}\n")
    return _exit_code(found)


def doctor(
    config: Path | None,
    zenoh_config: Path | None,
    *,
    vehicle_url: str | None,
    system_id: int | None,
    mavlink_key_file: Path | None = None,
    form: Form,
) -> int:
    """Print what is missing before the daemon will fly; return the exit code.

    0: nothing; 1: something is; 2: something could not be found out.

    Args:
        config: the daemon's own file, on its own computer; its files and disk are looked at, too.
        zenoh_config: how to reach it from another one; None for both scouts.
        vehicle_url: to ask the vehicle, too.
        system_id: of the vehicle; None if there is only one.
        mavlink_key_file: of a vehicle that signs its messages; None of one that does not.
        form: of the output.

    Raises:
        FileError: a file cannot be used.
        CommandError: no Zenoh session, or the vehicle's URL cannot be opened.
    """
    if system_id is not None and vehicle_url is None:
        raise CommandError("--system-id needs --vehicle: it selects one of a connection's vehicles")
    key = mavlink_key(mavlink_key_file, vehicle_url)
    files = None if config is None else load_daemon_files(config)
    seen = observe(bus_of(zenoh_config, config))
    found = [] if files is None else list(diagnose_files(files))
    found += diagnose(seen, None if files is None else files.contract)
    found += _vehicle(vehicle_url, system_id, files, seen, key)
    if form == "json":
        _print_json(found, {})
    else:
        for line in _lines(found):
            sys.stdout.write(f"{line}\n")
    return _exit_code(found)


def _vehicle(
    url: str | None,
    system_id: int | None,
    files: DaemonFiles | None,
    seen: Observation,
    key: bytes | None,
) -> list[Diagnosis]:
    if url is None:
        return []
    contract = seen.contract if files is None else files.contract
    if contract is None:
        text = "not asked: no contract to check it against is known"
        return [
            Diagnosis("vehicle", Verdict.UNKNOWN, text, "give the daemon's file by --daemon-config")
        ]
    from gcs_tools.doctor.vehicle import diagnose_vehicle  # noqa: PLC0415  MAVSDK: extra ground

    mission = None if files is None else files.mission
    return diagnose_vehicle(url, contract, mission, system_id, key)


def _exit_code(found: Iterable[Diagnosis]) -> int:
    worst = Verdict.worst(each.verdict for each in found)
    return {Verdict.HOLDS: 0, Verdict.BROKEN: EXIT_NO, Verdict.UNKNOWN: EXIT_BAD_INPUT}[worst]


def _lines(found: list[Diagnosis]) -> Iterator[str]:
    width = max(len(each.name) for each in found)
    for each in found:
        yield f"{_MARKS[each.verdict]:<7}  {each.name:<{width}}  {each.text}"
        if each.cure:
            yield f"{'':<7}  {'':<{width}}  -> {each.cure}"
    missing = sum(each.verdict is Verdict.BROKEN for each in found)
    unknown = sum(each.verdict is Verdict.UNKNOWN for each in found)
    if missing or unknown:
        yield f"{missing} missing, {unknown} unknown"
    else:
        yield "nothing is missing; clearway preflight checks the vehicle and authorizes the flight"


def _status_lines(vehicle: str, state: StateRecord) -> Iterator[tuple[str, str]]:
    armed = {True: "armed", False: "disarmed", None: "unknown"}[state.armed]
    yield "vehicle", f"{vehicle}, {armed}, mode {state.mode or 'unknown'}"
    yield "phase", f"{state.phase} ({state.state})"
    if state.virtual_obstacles:
        yield "sees", "VIRTUAL OBSTACLES: real ones are not seen"
    position = "none"
    if state.position_ned_m is not None:
        north_m, east_m, down_m = (round(each, 1) + 0.0 for each in state.position_ned_m)  # no -0.0
        position = f"{north_m} m north, {east_m} m east, {0.0 - down_m} m up"
    yield "position", f"{position}, {_age(state.telemetry_age_s)}"
    sensors = ", ".join(sorted(state.sensors)) or "none"
    yield "sensors", f"{sensors}, {_age(state.detection_age_s)}"
    yield "obstacles", f"{state.obstacles_known} known, {state.free_cells} cells seen free"


def _age(age_s: float | None) -> str:
    return "never heard" if age_s is None else f"{age_s:.2f} s old"


def _fields(seen: Observation) -> dict[str, Any] | None:
    if seen.state is None:
        return None
    fields: dict[str, Any] = json.loads(as_json(seen.state))
    return fields


def _print_json(found: list[Diagnosis], more: dict[str, Any]) -> None:
    document = {**more, "diagnoses": [each.document() for each in found]}
    sys.stdout.write(json.dumps(document, indent=2) + "\n")
