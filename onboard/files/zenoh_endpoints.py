"""How a process joins Zenoh, as Clearway's files state it."""

from __future__ import annotations

import ipaddress
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from onboard.files.yaml_file import FileModel

Endpoints = Annotated[tuple[str, ...], Field(strict=False)]


class ZenohEndpoints(FileModel):
    """How a process joins Zenoh; without endpoints it scouts this computer.

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

    @property
    def remote_access(self) -> str | None:
        """Why a process of another computer may reach this one; None where none can.

        What cannot be confirmed from these keys counts: a name that is not an address, or a file
        of Zenoh's own.  A router that joins is not known here.
        """
        if self.config_file is not None:
            return f"zenoh.config_file = {self.config_file} may let other computers in"
        if not self.connect and not self.listen:
            return "zenoh states no endpoint, so that it joins whatever answers its scouting"
        for key in ("connect", "listen"):
            for endpoint in getattr(self, key):
                if not _is_loopback(endpoint):
                    return f"zenoh.{key} has {endpoint} (expected a loopback address, 127.0.0.1)"
        return None

    def relative_to(self, directory: Path) -> Self:
        """Return the same with ``config_file`` resolved against the directory of its file."""
        if self.config_file is None:
            return self
        return self.model_copy(update={"config_file": directory / self.config_file})


def _is_loopback(endpoint: str) -> bool:
    """Tell whether an endpoint, ``protocol/address:port``, surely stays on this computer."""
    protocol, _, address = endpoint.partition("/")
    if protocol == "unixsock-stream":
        return True
    host = address.partition("?")[0].partition("#")[0].rpartition(":")[0].strip("[]")
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
