"""The commands to end a hold and to return, and their answer, as they cross Zenoh."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class _Message(BaseModel):
    # A newer version may send more fields: unknown ones are ignored.
    model_config = ConfigDict(frozen=True, extra="ignore")


Command = Literal["resume", "return"]


class ResumeCommand(_Message):
    """The operator's command; a query without it, as one of a whole tree of keys, is none.

    To return is a command of the same key, so that whatever proves who sends it holds for both.
    """

    version: Literal[1] = 1
    command: Command


class ResumeReason(_Message):
    """One reason for a refusal: its kind, for programs; what it is about; the text, for people."""

    kind: str
    subject: str = ""
    text: str


class ResumeAnswer(_Message):
    """Whether the vehicle obeys, and every reason if it does not."""

    version: Literal[1] = 1
    accepted: bool
    reasons: Annotated[tuple[ResumeReason, ...], Field(max_length=1000)] = ()
