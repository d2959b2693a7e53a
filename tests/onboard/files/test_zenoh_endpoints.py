"""How a process joins Zenoh: keys that fit together, and paths relative to their file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from onboard.files.yaml_file import FileError, validate
from onboard.files.zenoh_endpoints import ZenohEndpoints


def endpoints(**keys: Any) -> ZenohEndpoints:
    return validate(keys, ZenohEndpoints, source="bus.yaml")


def test_without_keys_a_peer_scouts() -> None:
    assert endpoints() == ZenohEndpoints(mode="peer", connect=(), listen=(), config_file=None)


def test_lists_become_tuples() -> None:
    both = endpoints(connect=["tcp/10.0.0.1:7447"], listen=["udp/0.0.0.0:7448", "tcp/[::]:7448"])
    assert both.connect == ("tcp/10.0.0.1:7447",)
    assert both.listen == ("udp/0.0.0.0:7448", "tcp/[::]:7448")


def test_a_client_connects_and_does_not_listen() -> None:
    assert endpoints(mode="client", connect=["tcp/router:7447"]).mode == "client"
    assert endpoints(mode="client", connect=["tcp/router:7447"], listen=[]).listen == ()
    with pytest.raises(FileError, match=r"a client cannot listen \(listen: tcp/0\.0\.0\.0:7448\)"):
        endpoints(mode="client", listen=["tcp/0.0.0.0:7448"])


@pytest.mark.parametrize(
    ("key", "value"), [("mode", "client"), ("connect", ["tcp/a:1"]), ("listen", ["tcp/a:1"])]
)
def test_a_configuration_of_zenohs_own_excludes_the_other_keys(key: str, value: Any) -> None:
    with pytest.raises(FileError, match=rf"config_file replaces {key}: leave {key} out"):
        endpoints(config_file="zenoh.json5", **{key: value})


def test_defaults_may_stand_beside_a_configuration_of_zenohs_own() -> None:
    assert endpoints(config_file="zenoh.json5", mode="peer", connect=[]).config_file is not None


@pytest.mark.parametrize(
    ("key", "value"),
    [("mode", "router"), ("connect", "tcp/a:1"), ("listen", [7447]), ("port", 7447)],
)
def test_bad_keys_are_named(key: str, value: Any) -> None:
    with pytest.raises(FileError, match=rf"bus\.yaml: {key}"):
        endpoints(**{key: value})


@pytest.mark.parametrize(
    ("written", "resolved"),
    [("zenoh.json5", "/etc/clearway/zenoh.json5"), ("/opt/zenoh.yaml", "/opt/zenoh.yaml")],
)
def test_a_relative_path_belongs_to_the_directory_of_its_file(written: str, resolved: str) -> None:
    moved = endpoints(config_file=written).relative_to(Path("/etc/clearway"))
    assert moved.config_file == Path(resolved)


def test_without_a_configuration_file_nothing_is_moved() -> None:
    scouting = endpoints()
    assert scouting.relative_to(Path("/etc")) is scouting
