"""What is known of another vehicle of the fleet: its run, what it holds, how far it may be."""

from __future__ import annotations

from collections import deque
from typing import Final, NamedTuple

from onboard.fleet.area import REST_SLACK_M, Place, around, holds
from onboard.fleet.messages import Head, Heartbeat, Tube
from onboard.geometry.frames import FloatArray

# So many runs that have ended are remembered; a message of an older one counts as of a new run,
# which no fresh echo will confirm.
_ENDED_MAX: Final = 64
# A message of one more run that nothing confirms is as good as lost.
_SEEN_MAX: Final = 64
# A vehicle holds two tubes; of others, no heartbeat has come yet that releases them.
_RECORDS_MAX: Final = 16


class Echo(NamedTuple):
    """A heartbeat of this run of ours that a peer had heard when it sent its own.

    Attributes:
        number: of our heartbeat.
        sent_s: when we sent it, by our clock.
    """

    number: int
    sent_s: float


class Peer:
    """One other vehicle, by its messages.

    A run of its daemon (``boot``) counts once a heartbeat of it echoes one that we sent after we
    had seen that run: it was alive then.  If messages of another run turn up, one of both is over,
    and no clock says which; so an echo has to confirm the run again.  Until one does, proposals are
    not acknowledged, and records stand.

    Attributes:
        boot: the run that counts; None before the first.
        records: its tubes that must not be entered, by number; of the run that counts.
        echoed: run and number of its newest heartbeat, to be echoed; None before the first.
        deviates: whether it was outside its own tube by its newest heartbeat that counted.
    """

    def __init__(self) -> None:
        self.boot: str | None = None
        self.records: dict[int, FloatArray] = {}
        self.echoed: tuple[str, int] | None = None
        self.deviates = False
        self._newest = -1
        self._seen: set[str] = set()
        self._ended: deque[str] = deque(maxlen=_ENDED_MAX)
        self._confirm_from = 0
        # Where it was, how far its body reached, and the earliest time at which that was so.
        self._place: tuple[Place, float, float] | None = None

    @property
    def is_known(self) -> bool:
        """Whether it has said, in answer to this run of ours, what it holds and where it is."""
        return self._place is not None

    def disc(self, until_s: float, speed_max_mps: float) -> tuple[Place, float] | None:
        """Return centre and radius of a disc that holds its body at all times until then.

        None if it has not answered this run of ours.
        """
        if self._place is None:
            return None
        place_m, reach_m, since_s = self._place
        return place_m, reach_m + speed_max_mps * (until_s - since_s)

    def counts(self, boot: str, next_number: int) -> bool:
        """Tell whether a message is of the run that counts; note a run that is new.

        Args:
            boot: of the message.
            next_number: what our next message will have, at least.
        """
        is_new = boot not in self._seen and boot not in self._ended
        if is_new and len(self._seen) < _SEEN_MAX:
            self._seen.add(boot)
            self._confirm_from = next_number
        return boot == self.boot and len(self._seen) == 1

    def is_over(self, number: int) -> bool:
        """Tell whether a tube is neither used nor proposed any more, by the newest heartbeat."""
        return number <= self._newest and number not in self.records

    def record(self, tube: Tube) -> bool:
        """Keep out of a tube that it has proposed; tell whether that is remembered."""
        if len(self.records) >= _RECORDS_MAX and tube.number not in self.records:
            return False
        # What a heartbeat has listed may be less: some of it has been passed.
        self.records.setdefault(tube.number, tube.boxes_m)
        return True

    def hear(self, heartbeat: Heartbeat, echo: Echo | None, next_number: int) -> bool:
        """Take a heartbeat; tell whether it counted.

        Args:
            heartbeat: of this peer.
            echo: which of ours it answers; None if it answers none of this run.
            next_number: what our next message will have, at least.
        """
        head = heartbeat.head
        counted = self.counts(head.boot, next_number)
        if head.boot in self._ended:
            return False
        self._note_for_echo(head)
        if not counted:
            if echo is None or echo.number < self._confirm_from:
                return False
            self._confirm(head.boot)
        if head.number <= self._newest:
            return False
        self._newest = head.number
        # Its reach allows for so much more than body and errors.
        body_m = max(heartbeat.reach_m - REST_SLACK_M, 0.0)
        self.deviates = not holds(heartbeat.active.boxes_m, around(heartbeat.position_m, body_m))
        held = [heartbeat.active]
        if heartbeat.outstanding is not None:
            held.append(heartbeat.outstanding)
        kept = {n: area for n, area in self.records.items() if not self._releases(heartbeat, n)}
        self.records = kept | {tube.number: tube.boxes_m for tube in held}
        if echo is not None:
            since_s = echo.sent_s - heartbeat.position_age_s
            if self._place is None or since_s >= self._place[2]:
                self._place = (heartbeat.position_m, heartbeat.reach_m, since_s)
        return True

    def _releases(self, heartbeat: Heartbeat, number: int) -> bool:
        """Tell whether a heartbeat says that a tube, which it does not list, is over.

        One that was proposed after it is not.
        """
        return number <= heartbeat.head.number

    def _note_for_echo(self, head: Head) -> None:
        if self.echoed is None or self.echoed[0] != head.boot or self.echoed[1] < head.number:
            self.echoed = (head.boot, head.number)

    def _confirm(self, boot: str) -> None:
        """Count a run, and no other that was seen."""
        if boot != self.boot:
            self.boot, self.records, self._newest = boot, {}, -1
        self._ended.extend(self._seen - {boot})
        self._seen = {boot}
