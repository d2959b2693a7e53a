"""Detection frames as JSON, version 1: one frame per message (docs: Detections)."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.perception.detection import DetectionFrame

log = logging.getLogger(__name__)


def parse_frame(payload: bytes) -> DetectionFrame:
    """Decode one detection frame.

    Raises:
        MalformedPayloadError: the payload is not JSON, or not a frame of version 1.
    """
    return parse(payload, DetectionFrame)


class JsonV1Source:
    """Reads version 1 of the JSON message."""

    def __init__(self) -> None:
        self.malformed = 0

    def read(
        self,
        payload: bytes,
        now_unix_s: float,  # noqa: ARG002  every frame has a stamp
    ) -> Sequence[DetectionFrame]:
        """Decode one message; a malformed one is counted, logged and dropped."""
        try:
            return (parse_frame(payload),)
        except MalformedPayloadError as error:
            self.malformed += 1
            log.debug("dropped a malformed detection frame: %s", error)
            return ()
