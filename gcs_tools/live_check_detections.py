"""Live detections against the contract: what the sensors sent in a few seconds."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from itertools import pairwise

from gcs_tools.preflight_finding import Finding, Verdict
from onboard.contract import Terms
from onboard.detection_monitor import CLOCK_TOLERANCE_S
from onboard.monitor import check_frame
from onboard.obstacles import DetectionFrame, parse_frame
from onboard.payload import MalformedPayloadError


@dataclass(frozen=True)
class Sample:
    """A payload as it arrived.

    Attributes:
        arrived_unix_s: when, by this computer's clock.
        payload: what.
    """

    arrived_unix_s: float
    payload: bytes


def check_detections(
    samples: Iterable[Sample], announced: Collection[str], terms: Terms[float], listened_s: float
) -> list[Finding]:
    """Hold what the sensors sent against what the contract assumes of them.

    Args:
        samples: everything that arrived, in order.
        announced: sources whose liveliness token is there.
        terms: the contract.
        listened_s: for how long.
    """
    frames, malformed = _read(samples)
    findings = []
    if not frames:
        text = f"no detection frame in {listened_s:g} s"
        findings.append(Finding("detections", "frames", Verdict.UNKNOWN, text))
    for source in sorted(frames):
        findings += _check_source(source, frames[source], terms, listened_s)
    for source in sorted(set(announced) - frames.keys()):
        text = f"announced, but silent for {listened_s:g} s"
        findings.append(Finding("detections", source, Verdict.BROKEN, text))
    if malformed:
        worst, count = malformed.most_common(1)[0]
        text = f"{malformed.total()} frames are malformed, {count} of them: {worst}"
        findings.append(Finding("detections", "format", Verdict.BROKEN, text))
    return findings


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


def _check_source(
    source: str,
    arrivals: list[tuple[float, DetectionFrame]],
    terms: Terms[float],
    listened_s: float,
) -> list[Finding]:
    stamps_s = [frame.stamp_unix_s for _, frame in arrivals]
    ages_s = [arrived_s - frame.stamp_unix_s for arrived_s, frame in arrivals]
    # When a frame arrives, what came into range just after the one before has waited this long.
    late_s = max(
        (
            arrived_s - before_s
            for (arrived_s, _), before_s in zip(arrivals[1:], stamps_s, strict=False)
        ),
        default=math.inf,
    )
    limit_s, tau_s, ahead_s = terms.frame_age_max_s, terms.reaction_time_s, -min(ages_s)
    rate_hz = len(arrivals) / listened_s
    age = f"newest frame up to {late_s:.3f} s old ({rate_hz:.0f} Hz), frame_age_max_s {limit_s:g} s"
    late = f"an object is seen up to {late_s:.3f} s late, reaction_time_s {tau_s:g} s"
    clock = f"stamps are {_ahead(ahead_s)} this computer's clock"
    increasing = all(after > before for before, after in pairwise(stamps_s))
    checks = [
        ("age", late_s <= limit_s, age),
        ("reaction", late_s <= tau_s, late),
        ("clock", ahead_s <= CLOCK_TOLERANCE_S and min(ages_s) < limit_s, clock),
        ("order", increasing, "stamps must increase from frame to frame"),
    ]
    findings = [
        Finding("detections", f"{source} {name}", Verdict.of(holds=holds), text)
        for name, holds, text in checks
    ]
    broken = {str(v): v for _, frame in arrivals for v in check_frame(frame, terms)}
    kinds = {each.assumption: text for text, each in broken.items()}
    findings += [
        Finding("detections", f"{source} {kind}", Verdict.BROKEN, text)
        for kind, text in sorted(kinds.items())
    ]
    if not kinds:
        last = arrivals[-1][1]
        text = f"range {last.range_m:g} m, field of view {last.field_of_view_deg:g}°, {last.frame}"
        findings.append(Finding("detections", f"{source} declares", Verdict.HOLDS, text))
    return findings


def _ahead(ahead_s: float) -> str:
    return f"{ahead_s:.3f} s ahead of" if ahead_s > 0.0 else f"at least {-ahead_s:.3f} s behind"
