"""The daemon's keys, as its configuration names them, and what it remembers of their use."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Final

from pydantic import BaseModel, ConfigDict, Field

from onboard.authentication.key_file import load_key
from onboard.authentication.operator_command import CommandGate, CommandJournal
from onboard.authentication.state_file import load_state, save_state
from onboard.files.daemon_config import DaemonConfig
from onboard.mavlink.signing import TICKS_PER_S, LinkSigning, timestamp_at

# How often the time stamp is saved; a start behind what was saved begins this much and a margin
# after it, so that no time stamp is used twice.
SAVE_PERIOD_S: Final = 10.0
_AHEAD: Final = round(2.0 * SAVE_PERIOD_S * TICKS_PER_S)


class LinkState(BaseModel):
    """The time stamp of the last signature, as saved."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    timestamp: Annotated[int, Field(ge=0, lt=1 << 48)] = 0


@dataclass(frozen=True)
class DaemonKeys:
    """What signs and checks; None each where no key is configured.

    Attributes:
        signing: of the MAVLink link.
        commands: opens what the operator sends.
        link_state: file in which `save` keeps the time stamp.
    """

    signing: LinkSigning | None = None
    commands: CommandGate | None = None
    link_state: Path | None = None

    @classmethod
    def load(cls, config: DaemonConfig, base: Path, state: Path, now_unix_s: float) -> DaemonKeys:
        """Read the keys, and what was remembered of their use.

        Args:
            config: the daemon's.
            base: directory of its file.
            state: directory of what outlives the daemon.
            now_unix_s: by this computer's clock, which may have been set back.

        Raises:
            FileError: a key or a state file cannot be used; or nothing can be written there.
        """
        signing, commands, link_state = None, None, None
        if config.mavlink.signing is not None:
            link_state = state / f"{config.vehicle}-mavlink-signing.json"
            key = load_key(base / config.mavlink.signing.key_file)
            first = first_timestamp(load_state(link_state, LinkState), now_unix_s)
            signing = LinkSigning(key, config.mavlink.signing.link_id, first)
            save_state(link_state, LinkState(timestamp=first))
        if config.operator_key_file is not None:
            path = state / f"{config.vehicle}-operator-commands.json"
            key = load_key(base / config.operator_key_file)
            journal = load_state(path, CommandJournal)
            save_state(path, journal)
            commands = CommandGate(key, config.vehicle, journal, partial(save_state, path))
        return cls(signing, commands, link_state)

    def is_genuine(self, frame: bytes) -> bool:
        """Tell whether a whole MAVLink frame may be the vehicle's, by its signature."""
        return self.signing is None or self.signing.objection(frame) is None

    def save(self) -> None:
        """Save the time stamp of the last signature.

        Raises:
            FileError: it cannot be written.
        """
        if self.signing is not None and self.link_state is not None:
            save_state(self.link_state, LinkState(timestamp=self.signing.timestamp))


def first_timestamp(saved: LinkState, now_unix_s: float) -> int:
    """Return the time stamp to begin with: the time, or later than all that were used before."""
    now = timestamp_at(now_unix_s)
    return now if now > saved.timestamp else saved.timestamp + _AHEAD
