"""The command to end a hold, and its answer, as they cross Zenoh."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class _Message(BaseModel):
    # A newer version may send more fields: unknown ones are ignored.
    model_config = ConfigDict(frozen=True, extra="ignore")


class ResumeCommand(_Message):
    """The operator's command; a query without it, as one of a whole tree of keys, is none."""

    version: Literal[1] = 1
    command: Literal["resume"]


class ResumeReason(_Message):
    """One reason for a refusal: its kind, for programs; what it is about; the text, for people."""

    kind: str
    subject: str = ""
    text: str


class ResumeAnswer(_Message):
    """Whether the flight goes on, and every reason if it does not."""

    version: Literal[1] = 1
    accepted: bool
    reasons: Annotated[tuple[ResumeReason, ...], Field(max_length=1000)] = ()
