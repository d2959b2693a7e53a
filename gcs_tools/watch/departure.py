"""What a vehicle lacks before it may depart, from what its daemon publishes."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Final

from gcs_tools.doctor.diagnosis import diagnose
from gcs_tools.doctor.observation import Observation
from gcs_tools.preflight.finding import Verdict
from onboard.events import EventName
from onboard.files.contract_file import Contract
from onboard.recording.messages import EventRecord, Margins, Record, StateRecord

# Statuses over which dropped input is counted: three seconds of them.
_STATES_KEPT: Final = 15


@dataclass(frozen=True)
class Lack:
    """One thing that is missing, and what to do about it."""

    text: str
    cure: str


@dataclass(frozen=True)
class Departure:
    """Whether the daemon waits in STANDBY, and what is missing before it will fly."""

    waiting: bool = False
    missing: tuple[Lack, ...] = ()


class DepartureCheck:
    """Collects what `departure` judges.

    Attributes:
        contract: the daemon's; None while it is not known.
    """

    def __init__(self) -> None:
        self.contract: Contract | None = None
        self._states: deque[StateRecord] = deque(maxlen=_STATES_KEPT)
        self._margins: Margins | None = None
        self._refusal: EventRecord | None = None
        self._refused_in: str | None = None

    def take(self, record: Record) -> None:
        """Take a record of the daemon."""
        if isinstance(record, StateRecord):
            self._states.append(record)
            # A refusal is said once: it stands as long as the pilot asks for what was refused.
            if record.phase != "standby" or record.mode != self._refused_in:
                self._refusal = None
        elif isinstance(record, Margins):
            self._margins = record
        elif isinstance(record, EventRecord) and record.name == EventName.REFUSED:
            self._refusal = record
            self._refused_in = self._states[-1].mode if self._states else None

    def departure(self) -> Departure:
        """Return what is missing now; nothing once the daemon flies."""
        if not self._states or self._states[-1].phase != "standby":
            return Departure()
        seen = Observation(
            states=tuple(self._states),
            margins=self._margins,
            events=() if self._refusal is None else (self._refusal,),
            contract=self.contract,
        )
        lacking = (each for each in diagnose(seen) if each.verdict is not Verdict.HOLDS)
        lacks = (Lack(f"{each.name}: {each.text}", each.cure) for each in lacking)
        # A refusal may say again what the status says.
        return Departure(waiting=True, missing=tuple(dict.fromkeys(lacks)))
