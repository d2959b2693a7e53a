"""Flight authorization: the daemon flies only what a recent live pre-flight check has passed.

The check (``clearway preflight``) puts a `FlightAuthorization` on ``clearway/<vehicle>/clearance``.
It names the contract that was checked by its hash, so that a daemon that holds another one stays
where it is, and when that was, so that an old check does not authorize a vehicle that has changed
since.  The latest one counts: a check that fails withdraws what an earlier one granted.
"""

from __future__ import annotations

import logging
from typing import Annotated, Final, Literal

from pydantic import BaseModel, ConfigDict, Field

from onboard.files.json_payload import MalformedPayloadError, parse

log = logging.getLogger(__name__)

# A check that was made later than this from now was stamped by a wrong clock.
CLOCK_TOLERANCE_S: Final = 1.0


class FlightAuthorization(BaseModel):
    """One check of a vehicle: what was checked, when, and whether it passed."""

    # A newer check may send more fields: unknown ones are ignored.
    model_config = ConfigDict(frozen=True, allow_inf_nan=False, extra="ignore")

    version: Literal[1] = 1
    contract_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    stamp_unix_s: float
    passed: bool
    checks: dict[str, str] = Field(default_factory=dict, max_length=1000)


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

    def receive(self, payload: bytes) -> None:
        """Take the outcome of a check; it replaces the one before."""
        try:
            self._latest = parse(payload, FlightAuthorization)
        except MalformedPayloadError as error:
            self.malformed += 1
            log.debug("dropped a malformed flight authorization: %s", error)

    def refusal(self, now_unix_s: float) -> str | None:
        """Return why the vehicle may not fly now; None if it may."""
        if self._age_max_s is None:
            return None
        if self._latest is None:
            return "no pre-flight check"
        if not self._latest.passed:
            return "the pre-flight check did not pass"
        if self._latest.contract_sha256 != self._contract_sha256:
            checked, ours = self._latest.contract_sha256[:12], self._contract_sha256[:12]
            return f"the pre-flight check was of contract {checked}, not {ours}"
        age_s = now_unix_s - self._latest.stamp_unix_s
        if -CLOCK_TOLERANCE_S <= age_s <= self._age_max_s:
            return None
        return f"the pre-flight check is {age_s:.0f} s old, limit {self._age_max_s:.0f} s"
