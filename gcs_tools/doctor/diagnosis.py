"""What a daemon lacks before it will fly: one sentence each, with its cure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from gcs_tools.cures.assumptions import ASSUMPTION_CURES
from gcs_tools.cures.cure import Cure
from gcs_tools.cures.reports import REFUSAL_CURES
from gcs_tools.doctor.observation import Observation
from gcs_tools.preflight.finding import Verdict
from gcs_tools.preflight.live.daemon import TELEMETRY_AGE_MAX_S
from onboard.contract.assessment import assess
from onboard.events import EventName
from onboard.files.contract_file import Contract
from onboard.guidance.departure import RefusalKind
from onboard.monitoring.detections import CLOCK_TOLERANCE_S
from onboard.recording.messages import SensorRecord, StateRecord

# A clock this far off was never set.
CLOCK_OFF_S: Final = 5.0
# A link that brings no position for this long is cut, not slow.
SILENT_S: Final = 2.0
_VEHICLES_PAGE: Final = "docs/vehicles.md"


@dataclass(frozen=True)
class Diagnosis:
    """One thing that was looked at.

    Attributes:
        name: what.
        verdict: whether it is as it has to be.
        text: what was found.
        cure: what to do about it; empty if nothing is to be done.
    """

    name: str
    verdict: Verdict
    text: str
    cure: str = ""

    def document(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            "name": self.name,
            "verdict": self.verdict.value,
            "text": self.text,
            "cure": self.cure,
        }


def _good(name: str, text: str) -> Diagnosis:
    return Diagnosis(name, Verdict.HOLDS, text)


def _bad(name: str, text: str, cure: str) -> Diagnosis:
    return Diagnosis(name, Verdict.BROKEN, text, cure)


def _unknown(name: str, text: str, cure: str) -> Diagnosis:
    return Diagnosis(name, Verdict.UNKNOWN, text, cure)


def diagnose(seen: Observation, expected: Contract | None = None) -> list[Diagnosis]:
    """Return what was found of a daemon, in the order in which it has to be cured.

    Args:
        seen: what it has published.
        expected: the contract of its file; None where the file is not known.
    """
    state = seen.state
    if state is None:
        text = "no status was heard"
        cure = (
            "start it with clearway-onboard --config F, or as a service, and let `connect` of the "
            "operator's file name an endpoint of its zenoh.listen"
        )
        return [_unknown("daemon", text, cure)]
    return [
        _good("daemon", f"heard, in phase {state.phase}"),
        *_contract(seen, expected),
        _link(seen, state),
        *_position(state),
        *_mission(state),
        *_sensors(seen, state),
        *_clocks(seen, state),
        _log(state),
        _authorization(state),
        *_holding(seen, state),
    ]


def contract_diagnosis(contract: Contract, altitude_m: float | None) -> Diagnosis:
    """Return whether a contract permits a flight on paper."""
    assessment, wanted = assess(contract, mission_altitude_m=altitude_m), contract.requirements
    accepted = wanted.stop and wanted.progress == "best_effort"
    broken = [
        each.name
        for each in assessment.clauses
        if not each.holds and not (accepted and each.concerns == "progress")
    ]
    if not broken:
        return _good("contract", "every clause that the flight needs holds")
    cure = "clearway preflight --contract F names the least change that satisfies each"
    return _bad("contract", f"does not hold: {', '.join(broken)}", cure)


def _contract(seen: Observation, expected: Contract | None) -> Iterator[Diagnosis]:
    if seen.contract is None:
        cure = "start the daemon again; another program may answer on its key"
        yield _unknown("daemon's contract", "it did not answer with its contract", cure)
        return
    name = seen.contract.sha256[:12]
    if expected is not None and expected.sha256 != seen.contract.sha256:
        yield _bad(
            "daemon's contract",
            f"it has {name}, the file says {expected.sha256[:12]}",
            "start the daemon again, so that it reads the file: systemctl restart clearway",
        )
        return
    yield _good("daemon's contract", name)
    if expected is None:
        yield contract_diagnosis(seen.contract, None)


def _link(seen: Observation, state: StateRecord) -> Diagnosis:
    name, age_s = "link", state.telemetry_age_s
    if state.link_doubt is not None:
        cure = "mavlink.signing.key_file has to name the key that the vehicle has; docs/security.md"
        return _bad(name, state.link_doubt, cure)
    garbage = seen.dropped("mavlink_garbage_bytes")
    if age_s is None and garbage > 0:
        text = f"{garbage} bytes that arrived meanwhile were no MAVLink"
        return _bad(name, text, "set the baud rate of mavlink.url to the autopilot's for this port")
    if age_s is None and seen.dropped("mavlink_foreign") > 0:
        text = "only other systems are heard, none with mavlink.system_id"
        return _bad(
            name, text, "set mavlink.system_id to the autopilot's MAV_SYS_ID (SYSID_THISMAV)"
        )
    if age_s is None or age_s > SILENT_S:
        since = "" if age_s is None else f" for {age_s:.0f} s"
        return _bad(
            name,
            f"the daemon has received no position{since}",
            "check mavlink.url, the wiring, and that MAVLink is on at the autopilot's port "
            "(PX4: MAV_1_CONFIG; ArduPilot: SERIALn_PROTOCOL 2)",
        )
    if age_s > TELEMETRY_AGE_MAX_S:
        text = f"the position is {age_s:.2f} s old, limit {TELEMETRY_AGE_MAX_S:g} s"
        return _bad(name, text, "raise the baud rate, or take other users off the link")
    return _good(name, f"position {age_s:.2f} s old, mode {state.mode or 'unknown'}")


def _position(state: StateRecord) -> Iterator[Diagnosis]:
    if state.position_doubt is not None:
        cure = "wait for the estimator to settle with a view of the sky; docs/position.md"
        yield _bad("position", state.position_doubt, cure)


def _mission(state: StateRecord) -> Iterator[Diagnosis]:
    """Say what was read from the vehicle, and where a flight was left."""
    name = "mission"
    if state.mission_doubt is not None:
        yield _bad(name, state.mission_doubt, REFUSAL_CURES[RefusalKind.MISSION].cure)
    elif state.mission:
        yield _good(name, f"read from the vehicle: {state.mission}")
    if state.resumable is not None:
        yield _good("flight left", f"at {state.resumable}: clearway resume goes on there")


def _sensors(seen: Observation, state: StateRecord) -> Iterator[Diagnosis]:
    page = f'{_VEHICLES_PAGE}, "Publish detections"'
    if (malformed := seen.dropped("frames_malformed")) > 0:
        text = f"{malformed} frames were malformed; clearway preflight --zenoh-config names why"
        yield _bad("sensor format", text, f"correct the message: {page}")
    if state.virtual_obstacles:
        yield _good("obstacles", "VIRTUAL OBSTACLES: real ones are not seen; open ground only")
    age_s = state.detection_age_s
    if age_s is None:
        cure = f"start the sensor, and let it connect to the daemon's zenoh.listen: {page}"
        yield _bad("sensor", "no frame of any sensor has arrived", cure)
        return
    if seen.contract is None:
        text = f"newest frame {age_s:.2f} s old, limit not known"
        yield _unknown("sensor", text, "start the daemon again")
        return
    limit_s = seen.contract.sensor.frame_age_max_s
    text = f"newest frame {age_s:.2f} s old, limit {limit_s:g} s"
    if age_s <= limit_s:
        yield _good("sensor", text)
        return
    silent = [name for name, each in state.sensors.items() if _is_silent(each, limit_s)]
    which = f" ({', '.join(silent)})" if silent else ""
    cure = "start the silent sensor again, or lower its rate until none is late"
    yield _bad("sensor", text + which, cure)


def _is_silent(sensor: SensorRecord, limit_s: float) -> bool:
    return sensor.age_s is None or sensor.age_s > limit_s


def _clocks(seen: Observation, state: StateRecord) -> Iterator[Diagnosis]:
    for source, sensor in sorted(state.sensors.items()):
        if sensor.stamp_ahead_s is not None and sensor.stamp_ahead_s > CLOCK_TOLERANCE_S:
            text = f"stamps of {source} are {sensor.stamp_ahead_s:.2f} s ahead of the daemon"
            cure = "set both computers' clocks by one source (chrony, PTP)"
            yield _bad("sensor clock", text, cure)
    ahead_s = seen.ahead_s or 0.0
    off = "ahead of" if ahead_s > 0.0 else "behind"
    text = f"the daemon's is {abs(ahead_s):.2f} s {off} this computer's"
    if abs(ahead_s) <= CLOCK_OFF_S:
        yield _good("clock", text)
    else:
        cure = "set the clock that is wrong (timedatectl); the daemon follows while disarmed"
        yield _bad("clock", text, cure)


def _log(state: StateRecord) -> Diagnosis:
    if not state.log_ended:
        return _good("log", "written")
    cure = "free the disk, set log_quota_mb in the daemon's file, and start the daemon again"
    return _bad("log", "the flight log has ended; the disk is full or gone", cure)


def _authorization(state: StateRecord) -> Diagnosis:
    if state.cleared is not False:
        return _good("authorization", "given, or not required")
    cure = (
        "clearway preflight --contract F --mission F --vehicle URL --zenoh-config F, with "
        "--operator-key F where the daemon has one"
    )
    return _bad("authorization", "require_preflight: no recent check has passed", cure)


def _holding(seen: Observation, state: StateRecord) -> Iterator[Diagnosis]:
    refusals = [event for event in seen.events if event.name == EventName.REFUSED]
    for reason in refusals[-1].data.get("reasons", []) if refusals else []:
        kind, text = str(reason.get("kind")), str(reason.get("text"))
        yield _bad("departure", text, _cure(REFUSAL_CURES, kind, "cure what it names"))
    failed = [event for event in seen.events if event.name == EventName.VIOLATION]
    for name, event in {str(each.data.get("assumption")): each for each in failed}.items():
        cure = _cure(ASSUMPTION_CURES, name, "docs/troubleshooting.md")
        yield _bad("assumption", event.text, cure)
    if state.phase == "hold":
        cure = "clearway watch or the daemon's messages say why; take over, then hand back"
        yield _bad("hold", "the daemon holds: an assumption has failed", cure)


def _cure(cures: Mapping[Any, Cure], name: str, otherwise: str) -> str:
    """Return the cure of a report by its name; a newer daemon may report others."""
    known: Cure | None = cures.get(name)
    return otherwise if known is None else known.cure
