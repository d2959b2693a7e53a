"""One flight of a campaign: its scenario, its seed, and the outcomes that count as success."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from gcs_tools.campaign.generator.allowances import Adversary
from gcs_tools.scenario import Outcome, Scenario

NO_FAULT: Final = "none"


@dataclass(frozen=True)
class FlightCase:
    """One flight of a campaign, and the outcomes that count as success.

    Attributes:
        scenario: vehicle, contract, mission, field and faults.
        seed: of the simulation's random numbers.
        variant: the breach or the kind of fault; `NO_FAULT` for neither.
        trigger: when the fault begins, in words.
        outcomes: those that count as success.
        covered: whether the contract promises that the flight has no collision.
        expectation: check the flight against its scenario file's ``expect``, too.
        refusable: the field was drawn without regard to the contract, so that a refusal by the
            pre-flight check is not a finding.
        time_limit_s: the flight is cut off there, wherever the vehicle is; None: it has to come to
            rest within a time that follows from its mission.
        adversary: who uses the contract's allowances; None for a flight without one.
    """

    scenario: Scenario
    seed: int
    variant: str = NO_FAULT
    trigger: str = ""
    outcomes: tuple[Outcome, ...] = ("arrived",)
    covered: bool = True
    expectation: bool = False
    refusable: bool = False
    time_limit_s: float | None = None
    adversary: Adversary | None = None


@dataclass(frozen=True)
class Extent:
    """The ranges that legs and speeds are drawn from, and where flights begin.

    Attributes:
        length_m: shortest and longest leg.
        speed_mps: slowest and fastest cruise.
        airborne: begin in hover instead of on the ground.
        ideal: fly ideal vehicles only.
    """

    length_m: tuple[float, float]
    speed_mps: tuple[float, float]
    airborne: bool
    ideal: bool = False


# Legs of about 45 m, long enough for two obstacles where the separation is wide.
FULL: Final = Extent((38.0, 52.0), (1.2, 5.0), airborne=False)
# Takes a third of the time: one obstacle, faster, starts in hover (a simulation shortcut).
# Its legs have no room for the errors of the field.
QUICK: Final = Extent((16.0, 20.0), (3.0, 5.5), airborne=True, ideal=True)
