"""Listens where the daemon of a file listens: its Zenoh keys, and its vehicle's link."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable, Iterator
from typing import Any, Final

import zenoh
from pydantic import ValidationError

from gcs_tools.console.errors import CommandError
from gcs_tools.sensors.observation import SensorObserver
from onboard.files.daemon_config import DaemonConfig
from onboard.files.sensor_sources import AnySource, FieldFileSource, MavlinkSource, Ros2Source
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.mavlink.connections import Link, open_link
from onboard.mavlink.link_url import LinkError
from onboard.perception.ros2.graph import TOKENS, parse_publisher
from onboard.perception.sources.registry import transforms_key, zenoh_key
from onboard.recording.messages import ADAPTERS, StateRecord
from onboard.zenoh_session import open_session, subscribe_with_history

_TICK_S: Final = 0.02
_TOKENS_TIMEOUT_S: Final = 1.0
_CLEARWAY: Final = "clearway"

Deliver = Callable[..., None]


def listen(config: DaemonConfig, seconds: float) -> SensorObserver:
    """Listen for some time, in place of the daemon or beside it.

    Raises:
        CommandError: no Zenoh session.
    """
    observer = SensorObserver(config, time.time() - time.monotonic())
    with _session(config.zenoh) as session:
        asyncio.run(_listen(config, session, observer, seconds))
    return observer


@contextlib.contextmanager
def _session(endpoints: ZenohEndpoints) -> Iterator[zenoh.Session]:
    """Join Zenoh as the daemon does; where it runs and listens already, beside it."""
    with contextlib.ExitStack() as stack:
        try:
            session = stack.enter_context(open_session(endpoints))
        except zenoh.ZError as error:
            beside = (*endpoints.connect, *endpoints.listen)
            if not endpoints.listen:
                where = ", ".join(beside) or str(endpoints.config_file or "multicast")
                raise CommandError(f"no Zenoh session with {where}: {error}") from error
            joined = ZenohEndpoints(mode=endpoints.mode, connect=beside, listen=())
            try:
                session = stack.enter_context(open_session(joined))
            except zenoh.ZError as second:
                raise CommandError(
                    f"no Zenoh session with {', '.join(beside)}: {second}"
                ) from second
        yield session


async def _listen(
    config: DaemonConfig, session: zenoh.Session, observer: SensorObserver, seconds: float
) -> None:
    begin_s = time.monotonic()
    _subscribe(config, session, observer)
    link = await _open_link(config, observer)
    try:
        while (now_s := time.monotonic()) < begin_s + seconds:
            if link is not None:
                # Asks for ranges and telemetry as the daemon does, and sends no setpoint.
                observer.link.keep_alive(now_s, active=False)
                link.send(observer.link.bytes_to_send())
            observer.tick(now_s)
            await asyncio.sleep(_TICK_S)
        observer.tick(time.monotonic())
    finally:
        if link is not None:
            link.close()
    info = session.info
    observer.around.peers = len(info.peers_zid()) + len(info.routers_zid())
    for reply in session.liveliness().get(TOKENS, timeout=_TOKENS_TIMEOUT_S):
        if reply.ok is not None and (found := parse_publisher(str(reply.ok.key_expr))):
            observer.around.publishers.add(found)


async def _open_link(config: DaemonConfig, observer: SensorObserver) -> Link | None:
    """Open the vehicle's link, which tells attitude and, of some sensors, ranges."""
    try:
        return await open_link(
            config.mavlink.url,
            lambda data: observer.receive_mavlink(data, time.monotonic()),
            config.mavlink.system_id,
        )
    except LinkError as error:
        observer.around.link_problem = str(error)
        return None


def _subscribe(config: DaemonConfig, session: zenoh.Session, observer: SensorObserver) -> None:
    loop = asyncio.get_running_loop()

    def into_loop(key: str, take: Deliver, declare: Callable[..., Any]) -> None:
        """Zenoh calls from its own thread, so its samples cross into the loop."""

        def receive(sample: zenoh.Sample) -> None:
            attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
            arguments = (str(sample.key_expr), sample.payload.to_bytes(), attachment)
            with contextlib.suppress(RuntimeError):  # the loop has closed: we are stopping
                loop.call_soon_threadsafe(take, *arguments)

        declare(key, receive)

    plain = session.declare_subscriber
    for source in config.sources:
        if isinstance(source, MavlinkSource | FieldFileSource):
            continue
        name = source.topic.strip("/")
        into_loop(f"**/{name}/**", _samples_of(source, observer), plain)
        if (key := transforms_key(source)) is not None:
            take = _transforms_of(source, observer)
            into_loop(key, take, lambda *args: subscribe_with_history(session, *args))

    def take_json(key: str, payload: bytes, _: bytes) -> None:
        observer.receive_json(key.split("/")[1], payload, time.monotonic())

    def take_status(_: str, payload: bytes, __: bytes) -> None:
        with contextlib.suppress(ValidationError):
            state: StateRecord = ADAPTERS[StateRecord].validate_json(payload, strict=True)
            observer.receive_status(state.sensors)

    into_loop(f"{_CLEARWAY}/*/obstacles", take_json, plain)
    into_loop(f"{_CLEARWAY}/{config.vehicle}/status", take_status, plain)


def _samples_of(source: Ros2Source, observer: SensorObserver) -> Deliver:
    """Return what takes the samples around a topic: those of the sensor's key, and others."""
    own = zenoh.KeyExpr(zenoh_key(source) or "")  # type: ignore[arg-type]  # each kind is one of them

    def take(key: str, payload: bytes, attachment: bytes) -> None:
        if key.startswith(f"{_CLEARWAY}/"):
            return
        if own.intersects(zenoh.KeyExpr(key)):
            observer.receive_sample(
                source.name, payload, time.monotonic(), key=key, attachment=attachment
            )
        else:
            observer.receive_stray(key)

    return take


def _transforms_of(source: AnySource, observer: SensorObserver) -> Deliver:
    def take(key: str, payload: bytes, _: bytes) -> None:
        observer.receive_transforms(source.name, payload, key=key)

    return take
