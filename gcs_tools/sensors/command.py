"""``clearway sensor check``: what arrives, from whom, how old, and a picture of it."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

from gcs_tools.sensors.diagnosis import Diagnosis, diagnose
from gcs_tools.sensors.listening import listen
from gcs_tools.sensors.observation import Heard, SensorObserver, ages_s
from gcs_tools.sensors.picture import free_ahead_m, nearest, picture
from onboard.files.daemon_config import DaemonConfig, load_daemon_config
from onboard.files.sensor_sources import AnySource
from onboard.perception.movers.moving_detection import ReportsFrame
from onboard.perception.sources.registry import zenoh_key

Form = Literal["text", "json"]


def check_sensors(path: Path, seconds: float, *, form: Form) -> bool:
    """Listen to the sensors of a daemon's file, and print what arrives.

    Args:
        path: the daemon's file.
        seconds: how long to listen.
        form: of the output.

    Returns:
        Whether each of them delivers frames that can be used.

    Raises:
        FileError: the file cannot be used.
        CommandError: no Zenoh session.
    """
    config = load_daemon_config(path)
    config = config.model_copy(update={"zenoh": config.zenoh.relative_to(path.parent)})
    seen = listen(config, seconds)
    return print_check(config, seen, form=form)


def print_check(config: DaemonConfig, seen: SensorObserver, *, form: Form) -> bool:
    """Print what was seen; return whether each sensor delivers."""
    found = diagnose(config, seen)
    sources = {source.name: source for source in config.sources}
    if form == "json":
        document = {
            "telemetry": seen.has_telemetry,
            "sensors": [_document(each, sources.get(each.name), seen) for each in found],
        }
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
    else:
        for each in found:
            for line in _lines(each, sources.get(each.name), seen):
                sys.stdout.write(f"{line}\n")
        if not seen.has_telemetry:
            sys.stdout.write("without telemetry, the vehicle counts as standing level\n")
    return all(each.delivers for each in found)


def _lines(diagnosis: Diagnosis, source: AnySource | None, seen: SensorObserver) -> Iterator[str]:
    mark = "ok" if diagnosis.delivers else "NOTHING"
    what = "JSON detections" if source is None else source.kind
    yield f"{mark:<8} {diagnosis.name} ({what}{_where(source)})"
    heard = seen.heard.get(diagnosis.name, Heard())
    for name, text in _facts(heard):
        yield f"{'':<8} {name:<9} {text}"
    if heard.frames and heard.frames[-1].frame == "body_frd":
        yield from (f"{'':<8} {line}" for line in picture(heard.frames[-1]))
    if diagnosis.text:
        yield f"{'':<8} {diagnosis.text}"
    if diagnosis.cure:
        yield f"{'':<8} -> {diagnosis.cure}"


def _where(source: AnySource | None) -> str:
    key = None if source is None else zenoh_key(source)
    return "" if key is None else f", {key}"


def _facts(heard: Heard) -> Iterator[tuple[str, str]]:
    if heard.arrivals_s:
        by = f", of {', '.join(sorted(heard.publishers))}" if heard.publishers else ""
        yield "arrives", f"{len(heard.arrivals_s)} messages, {heard.rate_hz:.1f} Hz{by}"
    if heard.ahead_s:
        least_s, most_s = ages_s(heard.ahead_s)
        named = f", frame_id {', '.join(sorted(heard.frame_ids))}" if heard.frame_ids else ""
        yield "stamps", f"{least_s:.3f} to {most_s:.3f} s old on arrival{named}"
    if heard.frames:
        frame = heard.frames[-1]
        if isinstance(frame, ReportsFrame):
            movers = {each.id for report in heard.frames for each in report.obstacles}
            text = f"{len(movers)} movers, within {frame.range_m:g} m; shows nothing free"
            yield "reports", text
        else:
            wide = f"{frame.field_of_view_deg:.0f}° wide"
            yield "sees", f"{len(frame.obstacles)} obstacles, {frame.range_m:.1f} m far, {wide}"
        if frame.frame == "body_frd":
            free_m = free_ahead_m(frame)
            ahead = "unknown" if free_m is None else f"{free_m:.2f} m"
            yield "nearest", f"{nearest(frame) or 'nothing'}; free ahead: {ahead}"
    for reason, count in heard.refused.most_common():
        yield "dropped", f"{count}: {reason}"
    if heard.from_daemon is not None:
        record = heard.from_daemon
        age = "never heard" if record.age_s is None else f"{record.age_s:.2f} s old"
        reasons = ", ".join(f"{count} {reason}" for reason, count in record.refused.items())
        yield "daemon", age + (f"; dropped: {reasons}" if reasons else "")


def _document(
    diagnosis: Diagnosis, source: AnySource | None, seen: SensorObserver
) -> dict[str, Any]:
    heard = seen.heard.get(diagnosis.name, Heard())
    least_s, most_s = ages_s(heard.ahead_s)
    last = heard.frames[-1] if heard.frames else None
    point = nearest(last) if last is not None and last.frame == "body_frd" else None
    return {
        "name": diagnosis.name,
        "kind": None if source is None else source.kind,
        "delivers": diagnosis.delivers,
        "text": diagnosis.text,
        "cure": diagnosis.cure,
        "messages": len(heard.arrivals_s),
        "rate_hz": heard.rate_hz,
        "stamp_age_min_s": None if math.isnan(least_s) else least_s,
        "stamp_age_max_s": None if math.isnan(most_s) else most_s,
        "frame_ids": sorted(heard.frame_ids),
        "publishers": sorted(heard.publishers),
        "frames": len(heard.frames),
        "refused": dict(heard.refused),
        "nearest_m": None if point is None else point.distance_m,
        "nearest_bearing_deg": None if point is None else point.bearing_deg,
        "range_m": None if last is None else last.range_m,
        "field_of_view_deg": None if last is None else last.field_of_view_deg,
    }
