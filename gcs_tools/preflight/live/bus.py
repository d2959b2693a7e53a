"""Checks over Zenoh, before a flight: detections, and the daemon that is to fly on them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import zenoh
from pydantic import Field

from gcs_tools.preflight.finding import Finding, Verdict
from gcs_tools.preflight.live.daemon import (
    ANSWER_TIMEOUT_S,
    Status,
    clock_ahead_s,
    contract_finding,
    detections_finding,
    mission_findings,
    ring_findings,
    sensor_findings,
    telemetry_finding,
    virtual_findings,
)
from gcs_tools.preflight.live.detections import Sample, check_detections
from onboard.authentication.operator_command import CommandKind, sealed
from onboard.contract.assessment import Assessment
from onboard.events import EventName
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import DaemonConfig
from onboard.files.yaml_file import FileError, load_yaml
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.monitoring.flight_authorization import FlightAuthorization

# How long the check listens to detections.
LISTEN_S = 3.0

# Name of the finding on whether the daemon may fly.
FLIGHT_AUTHORIZATION = "flight authorization"

_POLL_S = 0.05


class BusConfig(ZenohEndpoints):
    """``--zenoh-config F``: how to join Zenoh, and which vehicle to check."""

    vehicle: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")] = "vehicle"


def load_bus(path: Path) -> BusConfig:
    """Read a ``--zenoh-config``; paths in it are relative to it.

    Raises:
        FileError: the file cannot be read, or its content is not valid.
    """
    return load_yaml(path, BusConfig).relative_to(path.parent)


def bus_of(zenoh_config: Path | None, daemon_config: Path | None) -> BusConfig:
    """Return which vehicle is meant, and how to reach it; without a file, scouting finds it.

    Args:
        zenoh_config: says both.
        daemon_config: the daemon's own configuration, as `clearway fly` leaves it.

    Raises:
        FileError: a file is not usable.
    """
    if zenoh_config is not None:
        return load_bus(zenoh_config)
    if daemon_config is None:
        return BusConfig(connect=(), listen=())
    daemon = load_yaml(daemon_config, DaemonConfig)
    if daemon.zenoh.config_file is not None:
        # It may hold the daemon's own certificate and password, and the port that it listens on.
        raise FileError(
            f"{daemon_config}: zenoh.config_file is the daemon's own: give yours by --zenoh-config"
        )
    endpoints = daemon.zenoh.listen or daemon.zenoh.connect
    mode = daemon.zenoh.mode
    return BusConfig(vehicle=daemon.vehicle, mode=mode, connect=endpoints, listen=())


class BusCheck:
    """Checks detections and daemon of one vehicle, and authorizes that daemon to fly.

    Args:
        session: an open session.
        vehicle: its name in the Zenoh keys.
        operator_key: signs the authorization; None where the daemon needs no signature.
    """

    def __init__(
        self, session: zenoh.Session, vehicle: str, operator_key: bytes | None = None
    ) -> None:
        self._session, self._vehicle, self._operator_key = session, vehicle, operator_key
        self._prefix = f"clearway/{vehicle}"
        self._statuses: list[Status] = []
        self._refusals: list[str] = []
        self._daemon_ahead_s: float | None = None
        # If this computer sets its clock during the check, the other clocks must not seem to step.
        self._epoch_unix_s = time.time() - time.monotonic()

    def run(
        self,
        assessment: Assessment,
        sensors: tuple[str, ...] = (),
        rings: tuple[str, ...] = (),
    ) -> list[Finding]:
        """Listen for `LISTEN_S`, query the daemon, and check both against the contract.

        Args:
            assessment: the contract.
            sensors: names of those of the daemon's file, which the daemon alone hears; with them
                there need not be detections as JSON.
            rings: those of them that see all round.
        """
        samples: list[Sample] = []
        listeners = [
            self._session.declare_subscriber(
                f"{self._prefix}/obstacles",
                lambda sample: samples.append(
                    Sample(self._now_unix_s(), sample.payload.to_bytes())
                ),
            ),
            self._session.declare_subscriber(f"{self._prefix}/status", self._on_status),
        ]
        announced = self._announced()
        # Zenoh takes a moment to connect to its peers: counting starts with the first frame.
        self._until(lambda: bool(samples) or bool(sensors and self._statuses))
        time.sleep(LISTEN_S)
        for listener in listeners:
            listener.undeclare()  # type: ignore[no-untyped-call]  # untyped in its own stubs
        heard, statuses, terms = tuple(samples), tuple(self._statuses), assessment.terms
        self._daemon_ahead_s = clock_ahead_s(statuses)
        detections = check_detections(
            heard, announced, terms, LISTEN_S, self._daemon_ahead_s, needed=not sensors, rings=rings
        )
        return [
            *detections,
            *sensor_findings(statuses, sensors, terms),
            *ring_findings(statuses, rings, terms),
            self._contract(assessment.contract),
            detections_finding(statuses, terms),
            telemetry_finding(statuses),
            *virtual_findings(statuses),
            *mission_findings(statuses),
        ]

    def authorize(
        self,
        contract: Contract,
        findings: list[Finding],
        *,
        compliant: bool,
        accept_no_progress: bool = False,
    ) -> Finding:
        """Send the daemon the result of the whole check, and wait until it confirms.

        The result is stamped by the daemon's clock, by which the daemon computes its age.

        Args:
            contract: that was checked.
            findings: of the live check.
            compliant: whether the check on paper has passed.
            accept_no_progress: have the daemon fly once without a guarantee to arrive.
        """
        verdict = Verdict.worst(each.verdict for each in findings)
        passed = compliant and verdict is Verdict.HOLDS
        clearance = FlightAuthorization(
            contract_sha256=contract.sha256,
            stamp_unix_s=self._now_unix_s() + (self._daemon_ahead_s or 0.0),
            passed=passed,
            checks={f"{each.subject} {each.name}": each.verdict.value for each in findings},
            progress="best_effort" if accept_no_progress else None,
        )
        heard = self._sent(clearance, accepted=accept_no_progress)
        if not passed:
            verdict = Verdict.worst([Verdict.of(holds=compliant), verdict])
            text = "withheld: the check has not passed"
            return Finding("daemon", FLIGHT_AUTHORIZATION, verdict, text)
        if not heard:
            text = f"given, but the daemon did not confirm it within {ANSWER_TIMEOUT_S:g} s"
            if self._refusals:
                text += f": {self._refusals[-1]}"
            return Finding("daemon", FLIGHT_AUTHORIZATION, Verdict.UNKNOWN, text)
        text = "given, and confirmed by the daemon"
        if accept_no_progress:
            text = "given for one flight that may not arrive, and confirmed by the daemon"
        return Finding("daemon", FLIGHT_AUTHORIZATION, Verdict.HOLDS, text)

    def _sent(self, clearance: FlightAuthorization, *, accepted: bool) -> bool:
        """Send an authorization; tell whether the daemon confirms one that has passed."""
        self._statuses.clear()
        listeners = [
            self._session.declare_subscriber(f"{self._prefix}/status", self._on_status),
            self._session.declare_subscriber(f"{self._prefix}/events", self._on_event),
        ]
        payload = clearance.model_dump_json().encode()
        self._session.put(f"{self._prefix}/clearance", self._sealed(payload))
        heard = clearance.passed and self._until(lambda: self._confirmed(accepted=accepted))
        for listener in listeners:
            listener.undeclare()  # type: ignore[no-untyped-call]  # untyped in its own stubs
        return heard

    def _sealed(self, payload: bytes) -> bytes:
        """Return the authorization as the daemon expects it, stamped by the daemon's clock."""
        if self._operator_key is None:
            return payload
        return sealed(
            payload,
            key=self._operator_key,
            vehicle=self._vehicle,
            kind=CommandKind.CLEARANCE,
            now_unix_s=self._now_unix_s() + (self._daemon_ahead_s or 0.0),
        )

    def _on_event(self, sample: zenoh.Sample) -> None:
        try:
            event = json.loads(sample.payload.to_bytes())
        except ValueError:  # another node may publish something else under this key
            return
        if isinstance(event, dict) and event.get("name") == EventName.COMMAND_REFUSED:
            self._refusals.append(str(event.get("text")))

    def _confirmed(self, *, accepted: bool) -> bool:
        """Tell whether a status says that the daemon may fly, and flies as was accepted."""
        return any(
            each.document.get("cleared") is True
            and (each.document.get("progress") == "best_effort" or not accepted)
            for each in self._statuses
        )

    def _now_unix_s(self) -> float:
        return self._epoch_unix_s + time.monotonic()

    def _until(self, condition: Callable[[], bool]) -> bool:
        deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
        while not (holds := condition()) and time.monotonic() < deadline_s:
            time.sleep(_POLL_S)
        return holds

    def _on_status(self, sample: zenoh.Sample) -> None:
        try:
            status = json.loads(sample.payload.to_bytes())
        except ValueError:  # another node may publish something else under this key
            return
        if isinstance(status, dict):
            self._statuses.append(Status(self._now_unix_s(), status))

    def _announced(self) -> list[str]:
        replies = self._session.liveliness().get(
            f"{self._prefix}/obstacles/*", timeout=ANSWER_TIMEOUT_S
        )
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        return [key.rpartition("/")[2] for key in keys]

    def _contract(self, contract: Contract) -> Finding:
        replies = self._session.get(f"{self._prefix}/contract", timeout=ANSWER_TIMEOUT_S)
        answers = [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
        return contract_finding(answers, contract)
