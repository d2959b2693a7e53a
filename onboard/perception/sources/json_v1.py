"""Detection frames as JSON, versions 1 and 2: one frame per message (docs: Detections)."""

from __future__ import annotations

import logging
from collections.abc import Sequence

from pydantic import BaseModel, ConfigDict

from onboard.files.json_payload import MalformedPayloadError, parse
from onboard.perception.detection import DetectionFrame
from onboard.perception.movers.moving_detection import MovingFrame

log = logging.getLogger(__name__)


class _Version(BaseModel):
    model_config = ConfigDict(extra="ignore")

    version: int


def parse_frame(payload: bytes) -> DetectionFrame:
    """Decode one detection frame.

    Raises:
        MalformedPayloadError: the payload is not JSON, or not a frame of version 1 or 2.
    """
    if b'"version"' in payload and parse(payload, _Version).version == 2:
        return parse(payload, MovingFrame)
    return parse(payload, DetectionFrame)


class JsonV1Source:
    """Reads versions 1 and 2 of the JSON message."""

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
