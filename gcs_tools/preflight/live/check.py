"""The live part of ``clearway preflight``: vehicle by MAVSDK, detections and daemon by Zenoh."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass

import zenoh

from gcs_tools.console.errors import CommandError
from gcs_tools.console.interruption import interruptible
from gcs_tools.preflight.finding import Finding, Verdict
from gcs_tools.preflight.live.bus import BusCheck, BusConfig
from gcs_tools.preflight.live.vehicle import evaluate
from gcs_tools.vehicle.connection import CONNECT_TIMEOUT_S, connected_vehicle
from gcs_tools.vehicle.operator import UrlError, Vehicle, VehicleError
from gcs_tools.vehicle.survey import survey
from onboard.contract.assessment import Assessment
from onboard.files.mission_file import Mission
from onboard.zenoh_session import open_session

# Of a complete check: ten of `survey`, and connecting, the bus, authorizing the daemon.
STEPS = 13
Report = Callable[[str], None]


@dataclass(frozen=True)
class LiveRequest:
    """What to check.

    Attributes:
        vehicle_url: MAVSDK connection URL; None leaves the vehicle unchecked.
        bus: how to reach detections and daemon; None leaves both unchecked.
        endurance_s: hover time of a full battery, where the vehicle estimates no remaining time.
        connect_timeout_s: how long to wait for an autopilot.
        system_id: of the vehicle; None if there is only one on the connection.
        sensors: names of those of the daemon's file, each of which has to deliver.
        rings: those of them that see all round.
        accept_no_progress: have the daemon fly once without a guarantee to arrive.
        mavlink_key: of a vehicle that signs its messages; None of one that does not.
        operator_key: signs the authorization; None where the daemon needs no signature.
    """

    vehicle_url: str | None = None
    bus: BusConfig | None = None
    endurance_s: float | None = None
    connect_timeout_s: float = CONNECT_TIMEOUT_S
    system_id: int | None = None
    sensors: tuple[str, ...] = ()
    rings: tuple[str, ...] = ()
    accept_no_progress: bool = False
    mavlink_key: bytes | None = None
    operator_key: bytes | None = None


def check_live(
    request: LiveRequest,
    assessment: Assessment,
    mission: Mission | None,
    *,
    paper_compliant: bool,
    report: Report = lambda _: None,
) -> tuple[Finding, ...]:
    """Check everything that the request names; authorize the daemon to fly if all of it holds.

    Only a check of vehicle, mission, detections and daemon together can authorize it.

    Args:
        request: what to check.
        assessment: the contract.
        mission: what is to be flown.
        paper_compliant: whether the check on paper has passed.
        report: called before each step.

    Raises:
        CommandError: the Zenoh session or the connection cannot be opened; or several vehicles
            are on it and none was chosen.
        Interrupted: the operator gave up.
    """
    with ExitStack() as stack:
        bus = None if request.bus is None else _joined(request.bus, stack, request.operator_key)
        findings = []
        if request.vehicle_url is not None:
            findings += asyncio.run(
                _check_vehicle_at(request.vehicle_url, request, assessment, mission, report)
            )
        if bus is not None:
            report("detections and daemon")
            findings += bus.run(assessment, request.sensors, request.rings)
        if bus is not None and request.vehicle_url is not None and mission is not None:
            report("authorizing the daemon")
            finding = bus.authorize(
                assessment.contract,
                findings,
                compliant=paper_compliant,
                accept_no_progress=request.accept_no_progress,
            )
            findings.append(finding)
    return tuple(findings)


def _joined(config: BusConfig, stack: ExitStack, operator_key: bytes | None) -> BusCheck:
    """Join the bus until the stack is closed."""
    try:
        session = stack.enter_context(open_session(config))
    except zenoh.ZError as error:
        raise CommandError(f"cannot open a Zenoh session: {error}") from error
    return BusCheck(session, config.vehicle, operator_key)


async def _check_vehicle_at(
    url: str,
    request: LiveRequest,
    assessment: Assessment,
    mission: Mission | None,
    report: Report,
) -> list[Finding]:
    report("connecting")
    with interruptible() as interruption:
        try:
            async with connected_vehicle(
                url,
                interruption,
                request.connect_timeout_s,
                system_id=request.system_id,
                mavlink_key=request.mavlink_key,
            ) as vehicle:
                return await check_vehicle(
                    vehicle, assessment, mission, request.endurance_s, report
                )
        except UrlError:
            raise
        except VehicleError as error:
            return [Finding("vehicle", "connection", Verdict.UNKNOWN, str(error))]


async def check_vehicle(
    vehicle: Vehicle,
    assessment: Assessment,
    mission: Mission | None,
    endurance_s: float | None,
    report: Report = lambda _: None,
) -> list[Finding]:
    """Check a vehicle that is connected already.

    Raises:
        Interrupted: the operator gave up.
    """
    return evaluate(await survey(vehicle, report), assessment, mission, endurance_s)
