"""What Zenoh can tell before a flight: detections, and the daemon that is to fly on them."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import zenoh
from pydantic import Field

from gcs_tools.live_check_detections import Sample, check_detections
from gcs_tools.preflight_finding import Finding, Verdict
from onboard.clearance import Clearance
from onboard.config import Contract
from onboard.contract import Assessment
from onboard.yaml_file import load_yaml
from onboard.zenoh_endpoints import ZenohEndpoints

# How long detections are counted, and how long an answer may take.
LISTEN_S = 3.0
ANSWER_TIMEOUT_S = 3.0
# Telemetry this old has missed several messages on the daemon's link.
TELEMETRY_AGE_MAX_S = 0.25

_POLL_S = 0.05


class BusConfig(ZenohEndpoints):
    """``--zenoh-config F``: how to join Zenoh, and which vehicle to look at."""

    vehicle: Annotated[str, Field(pattern=r"^[A-Za-z0-9_-]+$")] = "vehicle"


def load_bus(path: Path) -> BusConfig:
    """Read a ``--zenoh-config``; paths in it are relative to it.

    Raises:
        FileError: the file is not usable.
    """
    return load_yaml(path, BusConfig).relative_to(path.parent)


class BusCheck:
    """Looks at one vehicle's keys, and tells its daemon what came of the whole check.

    Args:
        session: an open session.
        vehicle: name in the keys.
    """

    def __init__(self, session: zenoh.Session, vehicle: str) -> None:
        self._session = session
        self._prefix = f"clearway/{vehicle}"
        self._statuses: list[dict[str, Any]] = []

    def run(self, assessment: Assessment) -> list[Finding]:
        """Listen for `LISTEN_S`, ask the daemon, and hold all against the contract."""
        samples: list[Sample] = []
        listeners = [
            self._session.declare_subscriber(
                f"{self._prefix}/obstacles",
                lambda sample: samples.append(Sample(time.time(), sample.payload.to_bytes())),
            ),
            self._session.declare_subscriber(f"{self._prefix}/status", self._on_status),
        ]
        announced = self._announced()
        # It may take a moment to meet the peers: counting starts with the first frame.
        self._until(lambda: bool(samples))
        time.sleep(LISTEN_S)
        for listener in listeners:
            listener.undeclare()  # type: ignore[no-untyped-call]  # untyped in its own stubs
        heard = tuple(samples)
        return [
            *check_detections(heard, announced, assessment.terms, LISTEN_S),
            self._contract(assessment.contract),
            telemetry_finding(self._statuses),
        ]

    def clear(self, contract: Contract, findings: list[Finding], *, compliant: bool) -> Finding:
        """Tell the daemon what came of the whole check, and see that it has heard it.

        Args:
            contract: that was checked.
            findings: everything that was looked at live.
            compliant: whether the check on paper has passed.
        """
        verdict = Verdict.worst(each.verdict for each in findings)
        passed = compliant and verdict is Verdict.HOLDS
        clearance = Clearance(
            contract_sha256=contract.sha256,
            stamp_unix_s=time.time(),
            passed=passed,
            checks={f"{each.subject} {each.name}": each.verdict.value for each in findings},
        )
        self._statuses.clear()
        listener = self._session.declare_subscriber(f"{self._prefix}/status", self._on_status)
        self._session.put(f"{self._prefix}/clearance", clearance.model_dump_json().encode())
        heard = passed and self._until(
            lambda: any(each.get("cleared") is True for each in self._statuses)
        )
        listener.undeclare()  # type: ignore[no-untyped-call]  # untyped in its own stubs
        if not passed:
            verdict = Verdict.worst([Verdict.of(holds=compliant), verdict])
            return Finding("daemon", "clearance", verdict, "withheld: the check has not passed")
        if not heard:
            text = f"given, but the daemon has not said so within {ANSWER_TIMEOUT_S:g} s"
            return Finding("daemon", "clearance", Verdict.UNKNOWN, text)
        return Finding("daemon", "clearance", Verdict.HOLDS, "given, and heard by the daemon")

    def _until(self, condition: Callable[[], bool]) -> bool:
        deadline_s = time.monotonic() + ANSWER_TIMEOUT_S
        while not (holds := condition()) and time.monotonic() < deadline_s:
            time.sleep(_POLL_S)
        return holds

    def _on_status(self, sample: zenoh.Sample) -> None:
        try:
            status = json.loads(sample.payload.to_bytes())
        except ValueError:  # a neighbour that speaks something else is no status
            return
        if isinstance(status, dict):
            self._statuses.append(status)

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


def contract_finding(answers: list[bytes], contract: Contract) -> Finding:
    """Compare the contract that the daemon holds with the one that was checked."""
    if not answers:
        text = f"no daemon has answered within {ANSWER_TIMEOUT_S:g} s"
        return Finding("daemon", "contract", Verdict.UNKNOWN, text)
    try:
        held = {str(json.loads(answer)["sha256"]) for answer in answers}
    except (ValueError, TypeError, KeyError):
        return Finding("daemon", "contract", Verdict.UNKNOWN, "the answer is not a contract")
    if held == {contract.sha256}:
        return Finding("daemon", "contract", Verdict.HOLDS, f"the same, {contract.sha256[:12]}")
    others = ", ".join(sorted(each[:12] for each in held))
    text = f"the daemon holds {others}, checked was {contract.sha256[:12]}"
    return Finding("daemon", "contract", Verdict.BROKEN, text)


def telemetry_finding(statuses: list[dict[str, Any]]) -> Finding:
    """Tell whether the daemon's own link brings fresh telemetry."""
    ages_s = [each.get("telemetry_age_s") for each in statuses]
    known_s = [float(age_s) for age_s in ages_s if isinstance(age_s, int | float)]
    if not known_s:
        text = "the daemon has heard no position" if statuses else "no status from a daemon"
        return Finding("daemon", "telemetry", Verdict.UNKNOWN, text)
    text = f"up to {max(known_s):.3f} s old on its link, limit {TELEMETRY_AGE_MAX_S:g} s"
    fresh = max(known_s) <= TELEMETRY_AGE_MAX_S and len(known_s) == len(ages_s)
    return Finding("daemon", "telemetry", Verdict.of(holds=fresh), text)
