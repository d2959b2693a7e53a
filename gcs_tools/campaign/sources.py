"""Sources of a campaign's flights: a generator, or a scenario file with one seed after another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from gcs_tools.campaign.adversary.draw import SOURCE, adversary_case
from gcs_tools.campaign.generator.case import NO_FAULT, FlightCase
from gcs_tools.campaign.generator.generators import generated
from gcs_tools.scenario import Scenario


class Source(Protocol):
    """Provides the flights of a campaign; pickled and sent to worker processes."""

    @property
    def name(self) -> str:
        """Name on the command line."""

    def case(self, campaign_seed: int, number: int) -> FlightCase:
        """Return flight ``number``: the same for the same arguments, on every machine.

        Args:
            campaign_seed: of the whole campaign.
            number: of the flight, from 0.
        """


@dataclass(frozen=True)
class GeneratedSource:
    """Scenarios drawn by a generator."""

    name: str

    def case(self, campaign_seed: int, number: int) -> FlightCase:
        """Draw flight ``number``."""
        return generated(self.name, campaign_seed, number)


@dataclass(frozen=True)
class AdversarySource:
    """Flights of an adversary inside the contract.

    Attributes:
        moved: genes that replace the drawn ones, name and value.
    """

    moved: tuple[tuple[str, float], ...] = ()

    @property
    def name(self) -> str:
        """Name on the command line."""
        return SOURCE

    def case(self, campaign_seed: int, number: int) -> FlightCase:
        """Draw flight ``number``, with the moved genes."""
        return adversary_case(campaign_seed, number, dict(self.moved))


@dataclass(frozen=True)
class FileSource:
    """One scenario file, flown with one seed after another."""

    name: str
    scenario: Scenario

    def case(self, campaign_seed: int, number: int) -> FlightCase:
        """Return the scenario with the number's own seed, to be checked against its ``expect``."""
        expected, scenario = self.scenario.expect, self.scenario
        return FlightCase(
            scenario,
            seed=campaign_seed + number,
            variant=scenario.faults[0].kind if scenario.faults else NO_FAULT,
            outcomes=(expected.outcome,),
            covered=expected.collisions == 0,
            expectation=True,
        )
