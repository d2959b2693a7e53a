"""Why a sensor delivers nothing: one sentence each, with its cure."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from gcs_tools.sensors.observation import Heard, SensorObserver, Surroundings, ages_s
from onboard.files.daemon_config import DaemonConfig
from onboard.files.sensor_sources import (
    AnySource,
    FieldFileSource,
    MavlinkSource,
    Ros2Source,
    TrafficSource,
)
from onboard.perception.ros2.graph import Publisher
from onboard.perception.ros2.keys import TYPE_HASHES
from onboard.perception.sources.registry import MAVLINK_NAMES, TYPE_NAMES

# Stamps that are off by more than this on arrival come from a wrong clock.
_CLOCK_OFF_S: Final = 1.0
_AHEAD_MAX_S: Final = 0.1
_LISTED_MAX: Final = 5
_CLOCK_CURE: Final = "set the clocks of both computers by one source (chrony, PTP)"
# By how its reason begins.
_CURES: Final = (
    ("another type", "give the kind that the topic carries, or the topic of this kind"),
    ("unknown hash", "its definition of the type is not one of Humble, Jazzy or Kilted; update it"),
    ("two senders", "two senders on the link, or an autopilot that sends on: silence one of them"),
    ("two publishers", "two nodes publish the topic: stop one, or give each a topic of its own"),
    (
        "local origin not known yet",
        "wait for a GNSS fix: the autopilot's GPS_GLOBAL_ORIGIN places other vehicles",
    ),
    (
        "accuracy unknown",
        "state accuracy_m, or sigmas; what may be off by more than 100 m does not count",
    ),
    ("another frame_id", "set frame_id to that of the messages, or leave it out"),
    ("no pose at its stamp", "set use_sim_time to false, or the clocks by one source (chrony)"),
    ("mounting not known", "publish the transform from base_frame to its frame_id on tf_topic"),
    ("mounting changed", "two nodes state its mounting: stop one, then start the daemon again"),
    ("mounting not a rotation", "correct the transform: its turn is none"),
    ("mounting too far", "correct the transform: a sensor is within 3 m of base_frame"),
    (
        "does not look ahead",
        "correct mounting, blind_sectors_deg, field_of_view_deg: it has to see where it flies",
    ),
    ("mostly blind", "uncover and clean it, and raise own_radius_m above no part of its view"),
    ("not a single point", "uncover it; under an open sky state no_return_is_free_to_m"),
    ("comes faster", "lower its rate"),
    ("coordinate frame", "let it send frame BODY_FRD, GLOBAL or LOCAL_NED"),
    ("another sensor id", "set sensor_id to that of the sensor that looks forward"),
    ("no sector is known", "all sectors are 65535: the vehicle's own sensor sees nothing"),
    ("attachment", "its middleware is not the one of the file: set middleware"),
    ("not plain CDR", "its middleware does not send CDR: set middleware, or another kind"),
)
_OTHER_CURE: Final = "its driver sends what is no valid message of this kind: update it"


class Diagnosis(NamedTuple):
    """Whether a sensor delivers, in words.

    Attributes:
        name: of the sensor.
        delivers: whether frames arrived that can be used.
        text: what is wrong; empty if nothing is.
        cure: what to do about it.
    """

    name: str
    delivers: bool
    text: str = ""
    cure: str = ""


def diagnose(config: DaemonConfig, seen: SensorObserver) -> list[Diagnosis]:
    """Return a diagnosis of each sensor of the file, or of the JSON detections if it has none."""
    found = [_diagnose(source, seen) for source in config.sources]
    names = {source.name for source in config.sources}
    json_names = sorted(seen.heard.keys() - names)
    found += [_of_frames(name, seen.heard[name]) for name in json_names]
    if seen.malformed_json:
        reason, count = seen.malformed_json.most_common(1)[0]
        text = f"{seen.malformed_json.total()} frames are malformed, {count} of them: {reason}"
        cure = 'correct the message: docs/vehicles.md, "Publish detections"'
        found.append(Diagnosis("JSON detections", bool(found), text, cure))
    elif not found:
        found.append(_no_json(config, seen.around))
    return found


def _diagnose(source: AnySource, seen: SensorObserver) -> Diagnosis:
    heard, name = seen.heard[source.name], source.name
    if isinstance(source, FieldFileSource):
        text = f"VIRTUAL OBSTACLES of {source.field}: real ones are not seen"
        return Diagnosis(name, True, text)
    if heard.frames:
        return _of_frames(name, heard)
    record = heard.from_daemon
    if record is not None and record.age_s is not None and not heard.arrivals_s:
        return Diagnosis(name, delivers=True)
    if heard.arrivals_s:
        return Diagnosis(name, False, *_all_dropped(source, heard))
    if isinstance(source, TrafficSource) and seen.hears_vehicle():
        return Diagnosis(name, True, "no other vehicle reports itself: some may be there")
    if isinstance(source, MavlinkSource):
        why = _silent_link(source, seen)
    elif heard.taken_by_json:
        text = "another program publishes JSON detections under its name, which are dropped"
        why = text, "give that program's `source` another name"
    else:
        why = _silent_topic(source, seen.around)
    return Diagnosis(name, False, *why)


def _of_frames(name: str, heard: Heard) -> Diagnosis:
    """Return what is wrong with a sensor that delivers."""
    least_s, most_s = ages_s(heard.ahead_s)
    if least_s < -_AHEAD_MAX_S:
        text = f"its stamps are {-least_s:.2f} s ahead of this computer's clock"
        return Diagnosis(name, True, text, _CLOCK_CURE)
    if least_s > _CLOCK_OFF_S:
        text = f"its stamps are {most_s:.2f} s behind this computer's clock"
        return Diagnosis(name, True, text, _CLOCK_CURE)
    if heard.refused:
        text = f"{heard.refused.total()} of {len(heard.arrivals_s)} messages were dropped: "
        reason, _ = heard.refused.most_common(1)[0]
        return Diagnosis(name, True, text + reason, cure_of(reason))
    return Diagnosis(name, delivers=True)


def cure_of(reason: str) -> str:
    """Return what to do about messages that are dropped for a reason."""
    return next((cure for begin, cure in _CURES if reason.startswith(begin)), _OTHER_CURE)


def _all_dropped(source: AnySource, heard: Heard) -> tuple[str, str]:
    count = len(heard.arrivals_s)
    if not heard.refused:
        if source.kind == "distance_sensor":
            text = f"{count} messages arrived, of sensors that look down at the ground"
            return text, "let it state orientation 0 (forward), or mount one that looks forward"
        return f"{count} messages arrived, none of which was read yet", "listen longer: --for 10"
    reason, most = heard.refused.most_common(1)[0]
    text = f"all {count} messages were dropped, {most} of them: {reason}"
    cure = cure_of(reason)
    least_s, most_s = ages_s(heard.ahead_s)
    if reason == "no pose at its stamp" and not math.isnan(least_s):
        off = f"{-least_s:.1f} s ahead of" if least_s < 0.0 else f"{most_s:.1f} s behind"
        text += f"; its stamps are {off} this computer's clock"
    if reason == "another frame_id" and isinstance(source, Ros2Source):
        named = ", ".join(sorted(heard.frame_ids))
        text += f"; they name {named}, the file says {source.frame_id or 'nothing'}"
    return text, cure


def _silent_link(source: MavlinkSource, seen: SensorObserver) -> tuple[str, str]:
    message = MAVLINK_NAMES[source.kind]  # type: ignore[attr-defined]  # its classes have it
    around, link = seen.around, seen.link
    if around.link_problem is not None:
        text = f"the vehicle's link cannot be listened to: {around.link_problem}"
        if around.daemon_runs:
            text = f"the daemon has the vehicle's link, and has read no {message} on it"
            return text, "let the vehicle send it, or stop the daemon to listen in its place"
        return text, "stop the daemon, or what else has the port, or correct mavlink.url"
    if seen.hears_vehicle():
        text = f"the vehicle is heard, but sends no {message}"
        return text, (
            "let its driver send it with the vehicle's system id; ArduPilot: PRX1_TYPE; PX4: stream"
            f" {message} on this port"
        )
    if link.counters.garbage_bytes:
        text = f"{link.counters.garbage_bytes} bytes arrived that are no MAVLink"
        return text, "set the baud rate of mavlink.url to that of the autopilot's port"
    if link.counters.foreign_messages:
        text = "only other systems are heard on the vehicle's link"
        return text, "set mavlink.system_id to the autopilot's"
    return "the vehicle's link is silent", "check mavlink.url, wiring, and MAVLink on that port"


def _silent_topic(source: Ros2Source, around: Surroundings) -> tuple[str, str]:
    """Return why nothing arrives under a key, the nearest cause first."""
    topic, kind = f"/{source.topic.strip('/')}", TYPE_NAMES[source.kind]  # type: ignore[attr-defined]
    for text, cure in _other_keys(source, topic, around):
        return text, cure
    publishers = sorted(around.publishers)
    of_topic = [each for each in publishers if each.topic == topic]
    if of_topic:
        return _announced(source, of_topic[0], kind)
    same_kind = sorted({each.topic for each in publishers if each.type_name == kind})
    if same_kind:
        listed = ", ".join(same_kind[:_LISTED_MAX])
        return f"{topic} is not published; {kind} is on {listed}", f"set topic to {same_kind[0]}"
    if around.peers == 0:
        text = f"nothing on {topic}, and no Zenoh peer or router has joined"
        return text, (
            "start the router (ros2 run rmw_zenoh_cpp rmw_zenohd) or the bridge, and let "
            "zenoh.connect name it"
        )
    return f"nothing is published on {topic}", "start the driver; ros2 topic hz shows it there"


def _other_keys(source: Ros2Source, topic: str, around: Surroundings) -> Iterator[tuple[str, str]]:
    """Yield what the keys say that fit the topic, but not the file."""
    name = topic.strip("/")
    bridged = source.middleware != "rmw_zenoh"
    for key in sorted(around.keys):
        parts = key.split("/")
        ros = len(parts) >= 4 and "::msg::dds_::" in parts[-2]
        if bridged and ros:
            text = f"{topic} comes by rmw_zenoh, under {key}"
            yield text, "set middleware: rmw_zenoh"
        elif not bridged and key == name:
            text = f"{topic} comes by zenoh-bridge-ros2dds, under {key}"
            yield text, "set middleware: zenoh-bridge-ros2dds"
        elif not bridged and ros and "/".join(parts[1:-2]) == name:
            if parts[0] != str(source.domain_id):
                text = f"{topic} comes in ROS domain {parts[0]}, the file says {source.domain_id}"
                yield text, f"set domain_id: {parts[0]}"
            else:
                yield f"{topic} carries another type: {parts[-2]}", cure_of("another type")
        else:
            yield f"nothing on {topic}, but on {key}", "set topic to what is published"


def _announced(source: Ros2Source, publisher: Publisher, kind: str) -> tuple[str, str]:
    """Return why a publisher that announces itself is not heard."""
    by = f"{publisher.topic}, which {publisher.node} announces,"
    if publisher.type_name != kind:
        return f"{by} carries {publisher.type_name}", cure_of("another type")
    if publisher.domain != source.domain_id:
        text = f"{by} is in ROS domain {publisher.domain}, the file says {source.domain_id}"
        return text, f"set domain_id: {publisher.domain}"
    known = {f"RIHS01_{each}" for each in TYPE_HASHES[kind]} | {"TypeHashNotSupported"}
    if publisher.type_hash not in known:
        return f"{by} has another definition of {kind}", cure_of("unknown hash")
    return f"{by} was silent", "see whether the driver measures: ros2 topic hz"


def _no_json(config: DaemonConfig, around: Surroundings) -> Diagnosis:
    name, key = "JSON detections", f"clearway/{config.vehicle}/obstacles"
    if around.vehicles:
        other = min(around.vehicles)
        text = f"nothing on {key}, but on clearway/{other}/obstacles"
        return Diagnosis(name, False, text, f"set vehicle: {other}, or the sensor's vehicle")
    text = f"nothing on {key}, and the file has no `sources`"
    if around.peers == 0:
        text += "; no Zenoh peer has joined"
    cure = "start the sensor, let it connect to the daemon's zenoh.listen, or state `sources`"
    return Diagnosis(name, False, text, cure)
