"""``clearway watch``: shows a flight live on a page, in the terminal, in Foxglove; read-only."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator

import zenoh

from gcs_tools.console.errors import CommandError, Interrupted
from gcs_tools.console.interruption import interruptible
from gcs_tools.doctor.observation import contract_of
from gcs_tools.preflight.live.bus import BusConfig
from gcs_tools.watch.feed import Feed
from gcs_tools.watch.server import serving
from onboard.recording.messages import ZENOH_KEYS, StateRecord
from onboard.zenoh_session import open_session

_POLL_S = 0.1
_ASK_PERIOD_S = 5.0
_ANSWER_TIMEOUT_S = 1.0


def watch(
    bus: BusConfig, *, host: str, port: int, terminal: bool, foxglove_port: int | None = None
) -> None:
    """Show a flight until Ctrl-C.

    Args:
        bus: the vehicle, and how to reach it.
        host: address to serve on.
        port: of the page; 0 for any that is free.
        terminal: show it in this terminal instead of a page.
        foxglove_port: of a WebSocket for Foxglove beside it; None for none.

    Raises:
        CommandError: no Zenoh session, or an address cannot be served on.
    """
    feed = Feed()
    with (
        interruptible() as interruption,
        _serving_foxglove(feed, bus.vehicle, host, foxglove_port),
        _listening(feed, bus) as ask,
        # Ctrl-C is how this is meant to end.
        contextlib.suppress(Interrupted),
    ):

        def check() -> None:
            interruption.check()
            ask()

        if terminal:
            from gcs_tools.watch.terminal import show  # noqa: PLC0415  rich is optional

            show(feed, bus.vehicle, check)
        else:
            _serve(feed, bus.vehicle, host, port, check)


@contextlib.contextmanager
def _serving_foxglove(feed: Feed, vehicle: str, host: str, port: int | None) -> Iterator[None]:
    if port is None:
        yield
        return
    from gcs_tools.watch.foxglove_server import serving_foxglove  # noqa: PLC0415  optional SDK

    with serving_foxglove(feed, vehicle, host, port) as url:
        _print_url(url)
        yield


def _serve(feed: Feed, vehicle: str, host: str, port: int, check: Callable[[], None]) -> None:
    with serving(feed, vehicle, host, port) as url:
        _print_url(url)
        while True:
            check()
            time.sleep(_POLL_S)


def _print_url(url: str) -> None:
    sys.stdout.write(f"{url}\n")
    sys.stdout.flush()


@contextlib.contextmanager
def _listening(feed: Feed, bus: BusConfig) -> Iterator[Callable[[], None]]:
    """Listen while the context lasts; yield what asks for the contract, now and then."""
    prefix = f"clearway/{bus.vehicle}/"

    def receive(sample: zenoh.Sample) -> None:
        feed.receive(str(sample.key_expr).removeprefix(prefix), sample.payload.to_bytes())

    with contextlib.ExitStack() as stack:
        try:
            session = stack.enter_context(open_session(bus))
        except zenoh.ZError as error:
            where = ", ".join((*bus.connect, *bus.listen)) or "multicast"
            raise CommandError(f"no Zenoh session with {where}: {error}") from error
        for key in ZENOH_KEYS.values():
            session.declare_subscriber(prefix + key, receive)
        due_s = 0.0

        def ask() -> None:
            nonlocal due_s
            # A daemon that was started again may have another contract.
            if feed.latest(StateRecord) is None or time.monotonic() < due_s:
                return
            if contract := contract_of(session, prefix.rstrip("/"), _ANSWER_TIMEOUT_S):
                feed.declare(contract)
            due_s = time.monotonic() + _ASK_PERIOD_S

        yield ask
