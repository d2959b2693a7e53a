"""Checks the detections that the sensors sent in a few seconds against the contract."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

from gcs_tools.preflight.finding import Finding, Verdict
from onboard.contract.assessment import Terms
from onboard.files.json_payload import MalformedPayloadError
from onboard.monitoring.assumptions import ALL_ROUND_DEG, check_frame
from onboard.monitoring.detections import CLOCK_TOLERANCE_S
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.moving_detection import is_complete
from onboard.perception.sources.json_v1 import parse_frame

# The transit of a status hides smaller differences between two clocks.
_AGREEMENT_S: Final = 0.05


@dataclass(frozen=True)
class Sample:
    """A payload and its time of arrival.

    Attributes:
        arrived_unix_s: by this computer's clock.
        payload: as it arrived.
    """

    arrived_unix_s: float
    payload: bytes


def check_detections(
    samples: Iterable[Sample],
    announced: Collection[str],
    terms: Terms[float],
    listened_s: float,
    daemon_ahead_s: float | None,
    *,
    needed: bool = True,
    rings: Collection[str] = (),
) -> list[Finding]:
    """Check the frames of each sensor against the contract's assumptions.

    Stamps are compared with the daemon's clock, as the daemon does; this computer's may be wrong.

    Args:
        samples: everything that arrived, in order.
        announced: sources with a liveliness token.
        terms: the contract.
        listened_s: for how long.
        daemon_ahead_s: the daemon's clock less this computer's; None if it is not known.
        needed: whether the daemon has no other sensors.
        rings: those of its other sensors that see all round, which it says itself.
    """
    frames, malformed = _read(samples)
    findings = []
    if not frames and needed:
        text = f"no detection frame in {listened_s:g} s"
        findings.append(Finding("detections", "frames", Verdict.UNKNOWN, text))
    for source in sorted(frames):
        findings += _check_times(source, frames[source], terms, listened_s, daemon_ahead_s)
        findings += _check_declared(source, [frame for _, frame in frames[source]], terms)
    for source in sorted(set(announced) - frames.keys()):
        text = f"announced, but sent nothing in {listened_s:g} s"
        findings.append(Finding("detections", source, Verdict.BROKEN, text))
    if not rings:
        findings += _check_ring(frames, terms, needed=needed)
    if malformed:
        worst, count = malformed.most_common(1)[0]
        text = f"{malformed.total()} malformed frames, {count} of them: {worst}"
        findings.append(Finding("detections", "format", Verdict.BROKEN, text))
    return findings


def _check_ring(
    frames: Mapping[str, list[tuple[float, DetectionFrame]]], terms: Terms[float], *, needed: bool
) -> list[Finding]:
    """Check that a sensor sees all round, where movers are required; others than these may, too."""
    if terms.movers_level in ("none", "passive_in_view"):
        return []
    heard = [frame for arrivals in frames.values() for _, frame in arrivals]
    rings = [frame for frame in heard if frame.field_of_view_deg >= ALL_ROUND_DEG]
    if rings:
        text = "a sensor with a view of 360° is heard"
        found = [Finding("detections", "all_round", Verdict.HOLDS, text)]
        if not any(map(is_complete, rings)):
            text = "no frame of a sensor that sees all round says that it names all it sees"
            found.append(Finding("detections", "frame_complete", Verdict.BROKEN, text))
        return found
    verdict = Verdict.BROKEN if needed else Verdict.UNKNOWN
    return [Finding("detections", "all_round", verdict, "no sensor is heard that sees all round")]


def _read(
    samples: Iterable[Sample],
) -> tuple[dict[str, list[tuple[float, DetectionFrame]]], Counter[str]]:
    frames: dict[str, list[tuple[float, DetectionFrame]]] = {}
    malformed: Counter[str] = Counter()
    for sample in samples:
        try:
            frame = parse_frame(sample.payload)
        except MalformedPayloadError as error:
            malformed[str(error)] += 1
        else:
            frames.setdefault(frame.source, []).append((sample.arrived_unix_s, frame))
    return frames, malformed


def _check_times(
    source: str,
    arrivals: list[tuple[float, DetectionFrame]],
    terms: Terms[float],
    listened_s: float,
    daemon_ahead_s: float | None,
) -> list[Finding]:
    """Check age and order of the stamps of one source."""

    def finding(name: str, verdict: Verdict, text: str) -> Finding:
        return Finding("detections", f"{source} {name}", verdict, text)

    stamps_s = [frame.stamp_unix_s for _, frame in arrivals]
    increasing = all(after > before for before, after in pairwise(stamps_s))
    text = "stamps must increase from frame to frame"
    order = finding("order", Verdict.of(holds=increasing), text)
    if daemon_ahead_s is None:
        text = "no status of a daemon, with whose clock the stamps are compared"
        names = ("age", "reaction", "clock")
        return [*(finding(name, Verdict.UNKNOWN, text) for name in names), order]
    arrived_s = [arrival_s + daemon_ahead_s for arrival_s, _ in arrivals]
    ages_s = [at_s - stamp_s for at_s, stamp_s in zip(arrived_s, stamps_s, strict=True)]
    ahead_s = -min(ages_s)
    clock = (
        f"stamps are {_ahead(ahead_s)} the daemon's clock, "
        f"which is {_offset(daemon_ahead_s)} this computer's"
    )
    if ahead_s > CLOCK_TOLERANCE_S:
        text = "not known: the stamps are in the future"
        unknown = (finding(name, Verdict.UNKNOWN, text) for name in ("age", "reaction"))
        return [*unknown, finding("clock", Verdict.BROKEN, clock), order]
    late_s = _latest_s(arrived_s, stamps_s)
    limit_s, tau_s = terms.frame_age_max_s, terms.reaction_time_s
    rate_hz = len(arrivals) / listened_s
    age = f"newest frame up to {late_s:.3f} s old ({rate_hz:.0f} Hz), frame_age_max_s {limit_s:g} s"
    late = f"an object is reported up to {late_s:.3f} s late, reaction_time_s {tau_s:g} s"
    return [
        finding("age", Verdict.of(holds=late_s <= limit_s), age),
        finding("reaction", Verdict.of(holds=late_s <= tau_s), late),
        finding("clock", Verdict.of(holds=min(ages_s) < limit_s), clock),
        order,
    ]


def _latest_s(arrived_s: list[float], stamps_s: list[float]) -> float:
    """Return the longest time from a frame's stamp to the arrival of the next frame.

    An object that comes into range just after a frame is reported by the next one.
    """
    waits_s = (at_s - before_s for at_s, before_s in zip(arrived_s[1:], stamps_s, strict=False))
    return max(waits_s, default=math.inf)


def _check_declared(
    source: str, frames: list[DetectionFrame], terms: Terms[float]
) -> list[Finding]:
    """Check the range, field of view and uncertainty that one source declares in its frames."""
    broken = {str(v): v for frame in frames for v in check_frame(frame, terms)}
    kinds = {each.assumption: text for text, each in broken.items()}
    if kinds:
        return [
            Finding("detections", f"{source} {kind}", Verdict.BROKEN, text)
            for kind, text in sorted(kinds.items())
        ]
    last = frames[-1]
    resolved = [] if terms.thinnest_obstacle_m is None else _check_resolution(source, last, terms)
    text = f"range {last.range_m:g} m, field of view {last.field_of_view_deg:g}°, {last.frame}"
    return [Finding("detections", f"{source} declares", Verdict.HOLDS, text), *resolved]


def _check_resolution(source: str, frame: DetectionFrame, terms: Terms[float]) -> list[Finding]:
    """Check that a ray of a scan meets the thinnest obstacle declared, at the range used."""
    if frame.free_range_m is None or terms.thinnest_obstacle_m is None:
        return []
    apart_m = terms.detection_range_m * frame.bin_rad
    text = (
        f"{len(frame.free_range_m)} bearings are {apart_m:.3f} m apart at detection_range_m "
        f"{terms.detection_range_m:g} m, thinnest_obstacle_m {terms.thinnest_obstacle_m:g} m"
    )
    verdict = Verdict.of(holds=apart_m <= terms.thinnest_obstacle_m)
    return [Finding("detections", f"{source} resolution", verdict, text)]


def _ahead(ahead_s: float) -> str:
    return f"{ahead_s:.3f} s ahead of" if ahead_s > 0.0 else f"at least {-ahead_s:.3f} s behind"


def _offset(ahead_s: float) -> str:
    """Say how far the daemon's clock is from this computer's; transit hides small offsets."""
    if abs(ahead_s) < _AGREEMENT_S:
        return "the same as"
    return f"{abs(ahead_s):.1f} s {'ahead of' if ahead_s > 0.0 else 'behind'}"
