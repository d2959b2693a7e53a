"""Serves metrics over HTTP in threads of their own, where the configuration asks for it."""

from __future__ import annotations

from collections.abc import Callable

from onboard.files.daemon_config import MetricsOutput
from onboard.metrics.figures import Figures


class MetricsError(RuntimeError):
    """The metrics cannot be served; the message names the key."""


def serve(config: MetricsOutput, figures: Figures, contract_sha256: str) -> Callable[[], None]:
    """Serve metrics; return what ends that.

    Args:
        config: where.
        figures: that the tick writes.
        contract_sha256: of the contract as declared.

    Raises:
        MetricsError: prometheus-client is not installed, or the address not this computer's, or in
            use.
    """
    try:
        # Nothing else of the daemon needs it, and most vehicles are not scraped.
        from prometheus_client import (  # noqa: PLC0415  extra ``metrics``
            CollectorRegistry,
            ProcessCollector,
            start_http_server,
        )

        from onboard.metrics.exposition import FiguresCollector  # noqa: PLC0415  needs it, too
    except ModuleNotFoundError as error:
        text = "metrics: needs prometheus-client: pip install 'clearway[metrics]'"
        raise MetricsError(text) from error
    registry = CollectorRegistry()
    registry.register(FiguresCollector(figures, contract_sha256))
    ProcessCollector(registry=registry)
    host, port = config.address
    try:
        server, _ = start_http_server(port, host, registry)
    except (OSError, UnicodeError) as error:
        reason = (error.strerror if isinstance(error, OSError) else None) or str(error)
        raise MetricsError(f"metrics.listen = {config.listen}: {reason}") from error

    def close() -> None:
        server.shutdown()
        server.server_close()

    return close
