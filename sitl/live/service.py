"""The simulator in real time: couples a `Scene` to sockets, Zenoh and the clock."""

from __future__ import annotations

import asyncio
import gc
import logging
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

import zenoh
from pydantic_core import to_json

from onboard.files.obstacle_field import ObstacleField, load_field
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.zenoh_session import open_session
from sitl.config import SitlConfig
from sitl.environment.formats.ros2_topics import Ros2Publisher
from sitl.environment.sensor_message import ZenohMessage
from sitl.environment.truth_log import TRUTH_LOG_RATE_HZ, TruthLog
from sitl.live.transport import Send, Transport
from sitl.vehicle.scene import Scene
from sitl.vehicle.vehicle import warm_up

log = logging.getLogger(__name__)

_POLL_S = 0.002
_TRUTH_RATE_HZ = 20
_BEHIND_MAX_S = 0.5  # after a longer stall the simulation does not catch up


class ZenohError(RuntimeError):
    """A Zenoh session that cannot be opened; the message names the endpoints."""


class LiveSimulator:
    """Couple one vehicle's scene to sockets and Zenoh.

    Attributes:
        scene: the vehicle and its world.
    """

    def __init__(self, config: SitlConfig, field: ObstacleField) -> None:
        self._config = config
        self.scene = Scene(config, field, start_unix_s=time.time())
        self._senders: dict[int, Send] = {}
        self._origin_s = time.monotonic()

    def link_opened(self, link: int, send: Send) -> None:
        """Start to stream to a peer."""
        self._senders[link] = send
        self.scene.vehicle.autopilot.open_link(link)

    def link_received(self, link: int, data: bytes) -> None:
        """Pass bytes on to the autopilot."""
        self.scene.vehicle.receive(data, link)

    def link_closed(self, link: int) -> None:
        """Stop streaming to a peer."""
        self._senders.pop(link, None)
        self.scene.vehicle.autopilot.close_link(link)

    async def run(self, stop: asyncio.Event, session: zenoh.Session) -> None:
        """Serve until ``stop`` is set.

        Raises:
            TransportError: a MAVLink URL cannot be used.
            OSError: the truth log cannot be written.
        """
        config = self._config
        transport = Transport(self)
        with ExitStack() as stack:
            stack.callback(transport.close)
            for url in config.mavlink:
                await transport.open(url)
            truth_log = None
            if config.truth_log is not None:
                truth_log = stack.enter_context(
                    TruthLog(config.truth_log, self.scene.start_unix_s, self.scene.world.field)
                )
            bus = Bus(session, config, self.scene.publishers)
            # The scene's time began with the scene: were it to begin now, stamps would be late.
            self.scene.advance((time.monotonic() - self._origin_s) * config.speed_factor)
            log.info("ready: %s on %s", config.vehicle, ", ".join(config.mavlink))
            await self._serve(stop, bus, truth_log)

    async def _serve(self, stop: asyncio.Event, bus: Bus, truth_log: TruthLog | None) -> None:
        scene = self.scene
        published = logged = -1
        while not stop.is_set():
            scene.advance(self._now_s())
            for link, send in tuple(self._senders.items()):
                if data := scene.vehicle.bytes_to_send(link):
                    send(data)
            for detection in scene.take_detections():
                bus.publish(detection)
            time_s = scene.vehicle.truth.time_s
            if (due := int(time_s * _TRUTH_RATE_HZ + 1e-6)) > published:
                published = due
                bus.publish_truth(to_json(scene.truth_record()))
            if truth_log is not None and (due := int(time_s * TRUTH_LOG_RATE_HZ + 1e-6)) > logged:
                logged = due
                truth_log.write(scene.vehicle.truth, scene.world, scene.movers)
            await asyncio.sleep(_POLL_S)

    def _now_s(self) -> float:
        """Return the simulation time that corresponds to real time."""
        now_s = (time.monotonic() - self._origin_s) * self._config.speed_factor
        behind_s = now_s - self.scene.vehicle.truth.time_s
        if behind_s > _BEHIND_MAX_S * self._config.speed_factor:
            log.warning("simulation stalled for %.2f s and does not catch up", behind_s)
            self._origin_s += behind_s / self._config.speed_factor
            now_s -= behind_s
        return now_s


class Bus:
    """The simulator's keys on Zenoh.

    ``clearway/<vehicle>/obstacles`` carries the frames of every sensor that speaks JSON, for which
    a liveliness token ``clearway/<vehicle>/obstacles/<source>`` stands, and ``.../truth`` ground
    truth.  A sensor that speaks ROS 2 has the key and the token of its topic.

    Args:
        session: an open session.
        config: vehicle and sensors.
        publishers: of the sensors that speak ROS 2.
    """

    def __init__(
        self, session: zenoh.Session, config: SitlConfig, publishers: Sequence[Ros2Publisher] = ()
    ) -> None:
        prefix = f"clearway/{config.vehicle}"
        self._obstacles = session.declare_publisher(f"{prefix}/obstacles")
        self._topics = {one.key: session.declare_publisher(one.key) for one in publishers}
        self._truth = session.declare_publisher(f"{prefix}/truth")
        sources = [one.source for one in config.sensors if one.publishes == "json"]
        keys = [f"{prefix}/obstacles/{source}" for source in sources]
        session_id = str(session.info.zid())
        keys += [token for one in publishers if (token := one.token(session_id)) is not None]
        # Dropping a token withdraws it.
        self._tokens = [session.liveliness().declare_token(key) for key in keys]

    def publish(self, message: ZenohMessage) -> None:
        """Publish what has left a sensor."""
        if message.key is None:
            self._obstacles.put(message.payload)
        else:
            attachment = message.attachment or None
            self._topics[message.key].put(message.payload, attachment=attachment)

    def publish_truth(self, payload: bytes) -> None:
        """Publish ground truth."""
        self._truth.put(payload)


@contextmanager
def _session(endpoints: ZenohEndpoints) -> Iterator[zenoh.Session]:
    """Open a Zenoh session.

    Raises:
        FileError: Zenoh's own configuration file cannot be used.
        ZenohError: an endpoint is malformed or cannot be listened on.
    """
    with ExitStack() as stack:
        try:
            session = stack.enter_context(open_session(endpoints))
        except zenoh.ZError as error:
            where = f"listen {list(endpoints.listen)}, connect {list(endpoints.connect)}"
            raise ZenohError(f"zenoh: {where}: {error}") from error
        yield session


async def serve(config: SitlConfig) -> None:
    """Run every vehicle of the file until SIGINT or SIGTERM.

    Raises:
        FileError: the obstacle field, or Zenoh's own configuration file, cannot be used.
        ParameterError: a configured autopilot parameter does not exist or is out of range.
        ZenohError: the Zenoh session cannot be opened.
        TransportError, OSError: as :meth:`LiveSimulator.run`.
    """
    field = ObstacleField.of([]) if config.field is None else load_field(config.field)
    warm_up()
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    # Closing the terminal must not end a flight.
    loop.add_signal_handler(signal.SIGHUP, lambda: log.info("SIGHUP ignored"))
    simulators = [LiveSimulator(one, field) for one in config.each()]
    # What stays for good need not be looked through again and again, which takes 0.1 s.
    gc.collect()
    gc.freeze()
    with _session(config.zenoh) as session:
        await _run_all(simulators, stop, session)
    log.info("stopped")


async def _run_all(
    simulators: list[LiveSimulator], stop: asyncio.Event, session: zenoh.Session
) -> None:
    """Run the vehicles side by side; when one cannot run, stop all."""
    tasks = [asyncio.create_task(one.run(stop, session)) for one in simulators]
    done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_EXCEPTION)
    stop.set()
    await asyncio.gather(*tasks, return_exceptions=True)
    for task in done:
        task.result()
