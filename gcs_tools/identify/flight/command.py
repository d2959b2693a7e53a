"""``clearway identify --fly``: the edge of an identification flight, in the daemon's place.

The link, its keys, the contract and the geofence are those of the daemon's file; the daemon itself
must not run meanwhile, since two programs would command the vehicle.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gcs_tools.console.errors import EXIT_NO, CommandError
from gcs_tools.identify.command import identify
from gcs_tools.identify.flight.free_air import HEIGHT_BAND_M, FreeAir
from gcs_tools.identify.flight.pilot import IdentificationPilot, Stage
from gcs_tools.identify.flight.programme import Programme, programme
from gcs_tools.identify.flight.records import event_record, state_record
from gcs_tools.logs.flight_log import read_log
from onboard.authentication.keys import DaemonKeys
from onboard.contract.assessment import TICK_S, assess
from onboard.contract.run_on import contract_run_on
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import (
    DaemonConfig,
    load_daemon_config,
    log_directory,
    state_directory,
)
from onboard.files.geofence_file import Geofence
from onboard.files.yaml_file import FileError, load_yaml
from onboard.heap import freeze_gc_heap
from onboard.mavlink.connections import open_link
from onboard.mavlink.endpoint import MavlinkEndpoint
from onboard.mavlink.link_url import LinkError
from onboard.missions.fences import fence_of
from onboard.recording.messages import Record
from onboard.recording.recorder import FlightRecorder, LogFileError, LogPlace
from onboard.timing import Clock, request_realtime_priority

_VOUCHED: Final = "free"


@dataclass(frozen=True)
class FlightRequest:
    """What the operator asks for.

    Attributes:
        daemon: the daemon's file.
        air: the box of free air.
        speed_mps: of the passes; None for the contract's cruise speed.
        run_on: whether to let the stream of setpoints end.
        vouched: whether the operator has vouched for the box already.
        log: of the flight; None for one in the directory of the daemon's logs.
    """

    daemon: Path
    air: FreeAir
    speed_mps: float | None = None
    run_on: bool = False
    vouched: bool = False
    log: Path | None = None


def fly_and_identify(request: FlightRequest, margin: float) -> int:
    """Fly, then print what the log shows; return the exit code: 0 flown to the end, 1 not.

    Args:
        request: what to fly.
        margin: added to the measured values, as a share of them.

    Raises:
        CommandError: a file, the link or the log cannot be used, the box is too small, or the
            operator does not vouch for it.
    """
    try:
        config = load_daemon_config(request.daemon)
        base = request.daemon.parent
        contract = load_yaml(base / config.contract, Contract)
        geofence = load_yaml(base / config.geofence, Geofence) if config.geofence else None
        assessment = assess(contract, config.input_set)
        flown = programme(assessment, request.air, request.speed_mps, run_on=request.run_on)
        run_m = contract_run_on(assessment.terms).reach_m(flown.speed_mps)
        _confirm(flown, run_m if request.run_on else None, vouched=request.vouched)
        keys = DaemonKeys.load(config, base, state_directory(base, os.environ), time.time())
        link = MavlinkEndpoint(config.mavlink.system_id, keys.signing)
        fence = None if geofence is None else fence_of(geofence)
        pilot = IdentificationPilot(link, flown, fence, config.mavlink.telemetry_timeout_s)
        name = time.strftime("identify-%Y%m%d-%H%M%S.mcap", time.gmtime())
        place = LogPlace(request.log or log_directory(base, config, os.environ) / name)
        metadata = {"contract": contract.model_dump_json(), "contract_sha256": contract.sha256}
        with place.recorder(metadata) as recorder:
            asyncio.run(_Flight(config, keys, link, pilot, recorder).run())
            path = recorder.path
    except (FileError, LinkError, LogFileError) as error:
        raise CommandError(str(error)) from error
    _print(f"\nlog: {path}; clearway identify {path} prints this again\n")
    if not _has_flown(path):
        return EXIT_NO
    identify([path], margin=margin, form="table", output=None)
    return 0 if pilot.complete else EXIT_NO


def _confirm(flown: Programme, run_m: float | None, *, vouched: bool) -> None:
    """Say what the vehicle will do and where, and have the operator vouch for that air.

    Raises:
        CommandError: the operator does not.
    """
    air, margin_m = flown.air, flown.margin_m
    _print(
        f"{len(flown.passes)} passes at {flown.speed_mps:g} m/s, about {flown.duration_s:.0f} s "
        "and turns, at the height of the hand-over.\n"
        f"Free air: from {margin_m:.1f} m behind the vehicle to {air.length_m - margin_m:.1f} m "
        f"ahead of its nose, {air.width_m / 2.0:.1f} m to each side, {HEIGHT_BAND_M:g} m up and "
        "down.\nNo sensor is read: what stands there will be hit."
    )
    if run_m is not None:
        _print(
            "In the last pass the stream of setpoints ends: the contract expects the vehicle to "
            f"run on {run_m:.1f} m; PX4 then leaves OFFBOARD by its own failsafe."
        )
    if vouched:
        return
    if not sys.stdin.isatty():
        raise CommandError(
            "--fly needs a person who vouches for the free air: answer at a terminal, or state "
            "--vouch"
        )
    answer = input(f"Type '{_VOUCHED}' to vouch that this air is free of obstacles and people: ")
    if answer.strip().lower() != _VOUCHED:
        raise CommandError(f"not flown: the answer was {answer.strip()!r}, not '{_VOUCHED}'")


class _Flight:
    """Sockets, clock and log of one flight."""

    def __init__(
        self,
        config: DaemonConfig,
        keys: DaemonKeys,
        link: MavlinkEndpoint,
        pilot: IdentificationPilot,
        recorder: FlightRecorder,
    ) -> None:
        self._config, self._keys, self._link = config, keys, link
        self._pilot, self._recorder = pilot, recorder
        self._clock = Clock()

    async def run(self) -> None:
        """Fly until the pilot has taken over, or the vehicle has landed.

        Raises:
            LinkError: the link cannot be opened.
        """
        request_realtime_priority()
        mavlink, signing = self._config.mavlink, self._keys.signing
        link = await open_link(mavlink.url, self._receive, mavlink.system_id, self._keys.is_genuine)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM):
            loop.add_signal_handler(number, self._stop)
        loop.add_signal_handler(signal.SIGHUP, lambda: None)  # a lost terminal ends no flight
        freeze_gc_heap()
        _print(f"listening at {mavlink.url}: take off, point the nose, hand over (Ctrl-C ends)")
        due_s = self._clock.now_s()
        try:
            while not self._pilot.over:
                now_s = self._clock.now_s()
                if signing is not None:
                    signing.follow_clock(self._clock.epoch_unix_s + now_s)
                self._tick(now_s)
                if data := self._link.bytes_to_send():
                    link.send(data)
                    self._recorder.write_mavlink("sent", self._clock.epoch_unix_s + now_s, data)
                due_s = max(due_s + TICK_S, now_s - TICK_S)
                await asyncio.sleep(max(0.0, due_s - self._clock.now_s()))
        finally:
            link.close()
            with contextlib.suppress(FileError):
                self._keys.save()

    def _tick(self, now_s: float) -> None:
        self._pilot.tick(now_s)
        for event in self._link.security.take_news():
            _print(event.text)
        epoch_unix_s = self._clock.epoch_unix_s
        records: list[Record] = [state_record(self._pilot, self._link, now_s, epoch_unix_s)]
        for notice in self._pilot.take_notices():
            _print(notice.text)
            records.append(event_record(notice, epoch_unix_s))
        self._recorder.write(records)

    def _receive(self, data: bytes) -> None:
        now_s = self._clock.now_s()
        self._link.receive(data, now_s)
        self._recorder.write_mavlink("received", self._clock.epoch_unix_s + now_s, data)

    def _stop(self) -> None:
        """Come to rest; a second request ends the stream, for the autopilot to respond to."""
        now_s = self._clock.now_s()
        if self._pilot.stage in (Stage.BRAKING, Stage.HOLDING):
            self._pilot.end(now_s, "interrupted again")
        else:
            self._pilot.stop(now_s)


def _has_flown(path: Path) -> bool:
    return any(state.state == Stage.PASSING for state in read_log(path).states)


def _print(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()
