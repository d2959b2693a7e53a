"""Flight authorization: the daemon flies only what a recent live pre-flight check has passed.

The check (``clearway preflight``) puts a `FlightAuthorization` on ``clearway/<vehicle>/clearance``.
It names the contract that was checked by its hash, so that a daemon that holds another one stays
where it is, and when that was, so that an old check does not authorize a vehicle that has changed
since.  The latest one counts: a check that fails withdraws what an earlier one granted.

It may also accept, for one flight, that arrival is not guaranteed.  The contract and its hash stay:
from the departure to the landing it is flown as if it stated ``progress: best_effort``.
"""

from __future__ import annotations

import logging
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from onboard.files.json_payload import MalformedPayloadError, parse

log = logging.getLogger(__name__)

# A check that was made later than this from now was stamped by a wrong clock.
CLOCK_TOLERANCE_S: Final = 1.0
# An acceptance is no older than this at the departure, where the daemon needs no check otherwise.
ACCEPTANCE_AGE_MAX_S: Final = 900.0


class FlightAuthorization(BaseModel):
    """One check of a vehicle: what was checked, when, and whether it passed.

    Attributes:
        contract_sha256, stamp_unix_s, passed: of the check.
        checks: the verdict of each part of it.
        progress: ``best_effort`` if the operator accepts that the next flight may not arrive.
    """

    # A newer check may send more fields: unknown ones are ignored.
    model_config = ConfigDict(frozen=True, allow_inf_nan=False, extra="ignore")

    version: Literal[1] = 1
    contract_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    stamp_unix_s: float
    passed: bool
    checks: dict[str, str] = Field(default_factory=dict, max_length=1000)
    progress: Literal["best_effort"] | None = None


class FlightAuthorizationGate:
    """Decides whether what was checked may fly.

    Args:
        contract_sha256: of the contract that would be flown.
        age_max_s: how old a check may be; None where none is needed.

    Attributes:
        malformed: payloads that were not a `FlightAuthorization`.
    """

    def __init__(self, contract_sha256: str, age_max_s: float | None) -> None:
        self.malformed = 0
        self._contract_sha256 = contract_sha256
        self._age_max_s = age_max_s
        self._latest: FlightAuthorization | None = None
        # Whether the flight that has departed is one without a guarantee to arrive.
        self._accepted_in_flight = False

    def receive(self, payload: bytes) -> None:
        """Take the outcome of a check; it replaces the one before."""
        try:
            self._latest = parse(payload, FlightAuthorization)
        except MalformedPayloadError as error:
            self.malformed += 1
            log.debug("dropped a malformed flight authorization: %s", error)
        else:
            self._accepted_in_flight &= self._latest.passed

    def accepts_no_progress(self, now_unix_s: float) -> bool:
        """Tell whether this flight, or the next one, need not be guaranteed to arrive."""
        if self._accepted_in_flight:
            return True
        if self._latest is None or self._latest.progress is None:
            return False
        age_max_s = ACCEPTANCE_AGE_MAX_S if self._age_max_s is None else self._age_max_s
        return self._objection(now_unix_s, age_max_s) is None

    def begin_flight(self, now_unix_s: float) -> None:
        """Keep what is accepted until the vehicle lands, however often the pilot intervenes."""
        self._accepted_in_flight = self.accepts_no_progress(now_unix_s)

    def end_flight(self) -> None:
        """Forget an acceptance that was flown: it was for one flight."""
        if self._accepted_in_flight and self._latest is not None:
            self._latest = self._latest.model_copy(update={"progress": None})
        self._accepted_in_flight = False

    def refusal(self, now_unix_s: float) -> str | None:
        """Return why the vehicle may not fly now; None if it may."""
        if self._age_max_s is None:
            return None
        return self._objection(now_unix_s, self._age_max_s)

    def _objection(self, now_unix_s: float, age_max_s: float) -> str | None:
        if self._latest is None:
            return "no pre-flight check"
        if not self._latest.passed:
            return "the pre-flight check did not pass"
        if self._latest.contract_sha256 != self._contract_sha256:
            checked, ours = self._latest.contract_sha256[:12], self._contract_sha256[:12]
            return f"the pre-flight check was of contract {checked}, not {ours}"
        age_s = now_unix_s - self._latest.stamp_unix_s
        if -CLOCK_TOLERANCE_S <= age_s <= age_max_s:
            return None
        return f"the pre-flight check is {age_s:.0f} s old, limit {age_max_s:.0f} s"
