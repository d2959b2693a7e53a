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
from gcs_tools.preflight.live.vehicle import judge
from gcs_tools.vehicle.connection import CONNECT_TIMEOUT_S, UrlError, connected_vehicle
from gcs_tools.vehicle.operator import Vehicle, VehicleError
from gcs_tools.vehicle.survey import survey
from onboard.contract.assessment import Assessment
from onboard.files.models import Mission
from onboard.zenoh_session import open_session

# Of a look at everything: ten of `survey`, and connecting, the bus, clearing the daemon.
STEPS = 13
Report = Callable[[str], None]


@dataclass(frozen=True)
class LiveRequest:
    """What is to be looked at.

    Attributes:
        vehicle_url: MAVSDK connection URL; None for no vehicle.
        bus: how to reach detections and daemon; None for neither.
        endurance_s: hover time of a full battery, where the vehicle reckons none.
        connect_timeout_s: how long to wait for an autopilot.
        system_id: of the vehicle; None if there is only one on the connection.
    """

    vehicle_url: str | None = None
    bus: BusConfig | None = None
    endurance_s: float | None = None
    connect_timeout_s: float = CONNECT_TIMEOUT_S
    system_id: int | None = None


def check_live(
    request: LiveRequest,
    assessment: Assessment,
    mission: Mission | None,
    *,
    paper_compliant: bool,
    report: Report = lambda _: None,
) -> tuple[Finding, ...]:
    """Look at everything that was asked for; clear the daemon if all of it holds.

    Only a look at vehicle, mission, detections and daemon together can clear.

    Args:
        request: what to look at.
        assessment: the contract.
        mission: what is to be flown.
        paper_compliant: whether the check on paper has passed.
        report: told of every step before it is taken.

    Raises:
        CommandError: no Zenoh session, or not this connection, can be opened; or several
            vehicles are on it and none was chosen.
        Interrupted: the operator gave up.
    """
    with ExitStack() as stack:
        bus = None
        if request.bus is not None:
            try:
                session = stack.enter_context(open_session(request.bus))
            except zenoh.ZError as error:
                raise CommandError(f"no Zenoh session: {error}") from error
            bus = BusCheck(session, request.bus.vehicle)
        findings = []
        if request.vehicle_url is not None:
            findings += asyncio.run(
                _look_at(request.vehicle_url, request, assessment, mission, report)
            )
        if bus is not None:
            report("detections and daemon")
            findings += bus.run(assessment)
        if bus is not None and request.vehicle_url is not None and mission is not None:
            report("clearing the daemon")
            findings.append(bus.clear(assessment.contract, findings, compliant=paper_compliant))
    return tuple(findings)


async def _look_at(
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
                url, interruption, request.connect_timeout_s, system_id=request.system_id
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
    """Look at a vehicle that is connected already.

    Raises:
        Interrupted: the operator gave up.
    """
    return judge(await survey(vehicle, report), assessment, mission, endurance_s)
