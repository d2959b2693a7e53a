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


@pytest.mark.parametrize(
    ("keys", "text"),
    [
        ({"listen": ("tcp/127.0.0.1:7448",)}, None),
        ({"listen": ("tcp/[::1]:0", "udp/127.0.0.2:7448")}, None),
        ({"listen": ("unixsock-stream//run/clearway",)}, None),
        ({"connect": ("tcp/127.0.0.1:7447?rel=1#iface=lo",)}, None),
        ({}, "whatever answers its scouting"),
        (
            {"listen": ("tcp/127.0.0.1:7448", "tcp/0.0.0.0:7449")},
            "zenoh.listen has tcp/0.0.0.0:7449",
        ),
        ({"listen": ("tcp/[::]:7449",)}, "zenoh.listen has tcp/[::]:7449"),
        ({"listen": ("tcp/localhost:7449",)}, "zenoh.listen has tcp/localhost:7449"),
        ({"connect": ("tls/192.168.1.2:7447",)}, "zenoh.connect has tls/192.168.1.2:7447"),
        ({"listen": ("nonsense",)}, "zenoh.listen has nonsense"),
        ({"config_file": Path("z.json5")}, "zenoh.config_file = z.json5"),
    ],
)
def test_whether_other_computers_may_reach_a_process(
    keys: dict[str, Any], text: str | None
) -> None:
    found = ZenohEndpoints.model_validate(keys).remote_access
    assert (found is None) if text is None else (found is not None and text in found)
