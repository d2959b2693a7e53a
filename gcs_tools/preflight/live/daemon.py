"""Checks what the daemon reports: its contract, its detections and telemetry, its clock."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from gcs_tools.preflight.finding import NOT_SEEN, Finding, Verdict
from onboard.contract.assessment import Terms
from onboard.files.contract_file import Contract
from onboard.monitoring.detections import CLOCK_TOLERANCE_S

# How long an answer may take.
ANSWER_TIMEOUT_S = 3.0
# Telemetry this old has missed several messages on the daemon's link.
TELEMETRY_AGE_MAX_S = 0.25


class Status(NamedTuple):
    """A status of the daemon.

    Attributes:
        arrived_unix_s: when, by this computer's clock.
        document: its content.
    """

    arrived_unix_s: float
    document: dict[str, Any]


def clock_ahead_s(statuses: Sequence[Status]) -> float | None:
    """Return the daemon's clock less this computer's; None if no status states the time.

    The status with the shortest transit gives the best estimate, which is too low by that transit.
    """
    times_s = [(_number(each.document.get("time_s")), each.arrived_unix_s) for each in statuses]
    known_s = [time_s - arrived_s for time_s, arrived_s in times_s if time_s is not None]
    return max(known_s, default=None)


def contract_finding(answers: list[bytes], contract: Contract) -> Finding:
    """Compare the contract that the daemon has with the one that was checked."""
    if not answers:
        text = f"no daemon answered within {ANSWER_TIMEOUT_S:g} s"
        return Finding("daemon", "contract", Verdict.UNKNOWN, text)
    try:
        found = {str(json.loads(answer)["sha256"]) for answer in answers}
    except (ValueError, TypeError, KeyError):
        return Finding("daemon", "contract", Verdict.UNKNOWN, "the answer is not a contract")
    if found == {contract.sha256}:
        return Finding(
            "daemon",
            "contract",
            Verdict.HOLDS,
            f"the daemon has the checked contract, {contract.sha256[:12]}",
        )
    others = ", ".join(sorted(each[:12] for each in found))
    text = f"the daemon has {others}, expected the checked contract {contract.sha256[:12]}"
    return Finding("daemon", "contract", Verdict.BROKEN, text)


def detections_finding(statuses: Sequence[Status], terms: Terms[float]) -> Finding:
    """Check the age of the detections that the daemon has, which this computer may not hear."""
    return _age_finding(
        statuses,
        "detections",
        "detection_age_s",
        terms.frame_age_max_s,
        ("the daemon has no detections", "the newest frame of each of its sensors is"),
    )


def sensor_findings(
    statuses: Sequence[Status], sensors: Sequence[str], terms: Terms[float]
) -> list[Finding]:
    """Check that the daemon hears each sensor of its file, by what it last said of it.

    Args:
        statuses: of the daemon, in order.
        sensors: names of its sensors.
        terms: the contract.
    """
    said = statuses[-1].document.get("sensors") if statuses else None
    known = said if isinstance(said, dict) else {}
    return [_sensor_finding(name, known.get(name), terms, heard=bool(statuses)) for name in sensors]


def ring_findings(
    statuses: Sequence[Status], rings: Sequence[str], terms: Terms[float]
) -> list[Finding]:
    """Check that a sensor of the daemon's file that sees all round does so, where movers matter.

    Args:
        statuses: of the daemon, in order.
        rings: names of those of its sensors that see all round.
        terms: the contract.
    """
    if terms.movers_level == "none":
        return []
    return [_ring_finding(name, statuses, terms.frame_age_max_s) for name in rings]


def _ring_finding(name: str, statuses: Sequence[Status], limit_s: float) -> Finding:
    """Return how old its newest frame was at most, over all that the daemon said."""
    ages_s = []
    for status in statuses:
        sensors = status.document.get("sensors")
        said = sensors.get(name) if isinstance(sensors, dict) else None
        ages_s.append(_number(said.get("age_s")) if isinstance(said, dict) else None)
    known_s = [age_s for age_s in ages_s if age_s is not None]
    if not statuses:
        text = "no status received from a daemon"
        return Finding("sensor", f"{name} all_round", Verdict.UNKNOWN, text)
    if len(known_s) < len(ages_s):
        text = "the daemon did not hear it all the time: nothing else sees all round"
        return Finding("sensor", f"{name} all_round", Verdict.BROKEN, text)
    text = f"newest frame up to {max(known_s):.3f} s old in {len(known_s)} statuses"
    text += f", frame_age_max_s {limit_s:g} s"
    holds = max(known_s) <= limit_s
    return Finding("sensor", f"{name} all_round", Verdict.of(holds=holds), text)


def _sensor_finding(name: str, said: object, terms: Terms[float], *, heard: bool) -> Finding:
    if not heard:
        return Finding("sensor", name, Verdict.UNKNOWN, "no status received from a daemon")
    if not isinstance(said, dict):
        text = "the daemon does not know it: it was started with another file"
        return Finding("sensor", name, Verdict.BROKEN, text)
    age_s, ahead_s = _number(said.get("age_s")), _number(said.get("stamp_ahead_s")) or 0.0
    refused = said.get("refused")
    reasons = sorted(map(str, refused)) if isinstance(refused, dict) else []
    why = f"; dropped: {', '.join(reasons)[:200]}" if reasons else ""
    limit_s = terms.frame_age_max_s
    if age_s is None:
        text = f"nothing that can be used was heard{why}: clearway sensor check says why"
        return Finding("sensor", name, Verdict.BROKEN, text)
    if ahead_s > CLOCK_TOLERANCE_S:
        text = f"its stamps are {ahead_s:.2f} s ahead of the daemon's clock"
        return Finding("sensor", name, Verdict.BROKEN, text)
    text = f"newest frame {age_s:.3f} s old, frame_age_max_s {limit_s:g} s{why}"
    return Finding("sensor", name, Verdict.of(holds=age_s <= limit_s), text)


def virtual_findings(statuses: Sequence[Status]) -> list[Finding]:
    """Return that the daemon flies among virtual obstacles, if it does."""
    if not any(each.document.get("virtual_obstacles") is True for each in statuses):
        return []
    return [Finding("daemon", "VIRTUAL OBSTACLES", Verdict.HOLDS, NOT_SEEN)]


def mission_findings(statuses: Sequence[Status]) -> list[Finding]:
    """Say what the daemon has read from the vehicle; nothing where a file states its mission."""
    document = statuses[-1].document if statuses else {}
    doubt, read = document.get("mission_doubt"), document.get("mission")
    if isinstance(doubt, str):
        return [Finding("daemon", "mission", Verdict.BROKEN, doubt)]
    if isinstance(read, str) and read:
        return [Finding("daemon", "mission", Verdict.HOLDS, f"read from the vehicle: {read}")]
    return []


def telemetry_finding(statuses: Sequence[Status]) -> Finding:
    """Check the daemon's own link: the age of the telemetry, and whether signatures agree."""
    doubts = [each.document.get("link_doubt") for each in statuses]
    if doubts and isinstance(doubts[-1], str):
        return Finding("daemon", "telemetry", Verdict.BROKEN, doubts[-1])
    return _age_finding(
        statuses,
        "telemetry",
        "telemetry_age_s",
        TELEMETRY_AGE_MAX_S,
        ("the daemon has received no position", "the position on its link is"),
    )


def _age_finding(
    statuses: Sequence[Status], name: str, key: str, limit_s: float, words: tuple[str, str]
) -> Finding:
    lacking, subject = words
    if not statuses:
        return Finding("daemon", name, Verdict.UNKNOWN, "no status received from a daemon")
    ages_s = [_number(each.document.get(key)) for each in statuses]
    known_s = [age_s for age_s in ages_s if age_s is not None]
    if len(known_s) < len(ages_s):
        return Finding("daemon", name, Verdict.BROKEN, lacking)
    text = f"{subject} up to {max(known_s):.3f} s old, limit {limit_s:g} s"
    return Finding("daemon", name, Verdict.of(holds=max(known_s) <= limit_s), text)


def _number(value: object) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(value)
