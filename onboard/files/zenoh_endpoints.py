"""How a process joins Zenoh, as Clearway's files state it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from onboard.files.yaml_file import FileModel

Endpoints = Annotated[tuple[str, ...], Field(strict=False)]


class ZenohEndpoints(FileModel):
    """How a process joins Zenoh; without endpoints it scouts by multicast.

    A peer talks to other peers directly.  A client talks through what it connects to, which is what
    a router on another computer needs.
    """

    mode: Literal["peer", "client"] = Field(
        "peer", description="client: through the router that it connects to"
    )
    connect: Endpoints = ()
    listen: Endpoints = ()
    config_file: Annotated[Path | None, Field(strict=False)] = Field(
        None,
        description="Zenoh's own configuration (JSON5 or YAML) instead: TLS, user and password",
    )

    @model_validator(mode="after")
    def _keys_fit(self) -> Self:
        if self.mode == "client" and self.listen and "listen" in self.model_fields_set:
            raise ValueError(f"a client cannot listen (listen: {', '.join(self.listen)})")
        if self.config_file is not None:
            for key in ("mode", "connect", "listen"):
                if getattr(self, key) != type(self).model_fields[key].default:
                    raise ValueError(f"config_file replaces {key}: leave {key} out")
        return self

    def relative_to(self, directory: Path) -> Self:
        """Return the same with ``config_file`` resolved against the directory of its file."""
        if self.config_file is None:
            return self
        return self.model_copy(update={"config_file": directory / self.config_file})
