"""Who meets whom on Zenoh: directly, through a router, with and without a password."""

from __future__ import annotations

import gc
import json
import queue
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import zenoh
import zenoh.ext

from gcs_tools.preflight.live.bus import bus_of, load_bus
from onboard.files.yaml_file import FileError, validate
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.zenoh_session import _configuration, open_session, subscribe_with_history
from sitl.config import load_sitl_config

KEY = "clearway/v1/obstacles"


def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def router(where: str, **settings: Any) -> Iterator[None]:
    """Run a router, as ``zenohd`` would."""
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([where]))
    config.insert_json5("scouting/multicast/enabled", "false")
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    session = zenoh.open(config)
    try:
        yield
    finally:
        session.close()  # type: ignore[no-untyped-call]


def hear(heard: set[int], number: int, _: zenoh.Sample) -> None:
    heard.add(number)


def meet(*joining: ZenohEndpoints, patience_s: float = 10.0) -> bool:
    """Tell whether what the first says reaches all others."""
    with ExitStack() as stack:
        speaker, *listeners = [stack.enter_context(open_session(each)) for each in joining]
        heard: set[int] = set()
        for number, session in enumerate(listeners):
            session.declare_subscriber(KEY, partial(hear, heard, number))
        publisher = speaker.declare_publisher(KEY)
        deadline_s = time.monotonic() + patience_s
        while len(heard) < len(listeners) and time.monotonic() < deadline_s:
            publisher.put(b"{}")
            time.sleep(0.02)
        return len(heard) == len(listeners)


WAYS: dict[str, Callable[[str], ZenohEndpoints]] = {
    "peer": lambda where: ZenohEndpoints(connect=(where,)),
    "client": lambda where: ZenohEndpoints(mode="client", connect=(where,)),
    "listening peer": lambda where: ZenohEndpoints(connect=(where,), listen=(endpoint(),)),
}


@pytest.mark.parametrize("first", WAYS)
@pytest.mark.parametrize("second", WAYS)
def test_all_that_only_connect_to_a_router_meet(first: str, second: str) -> None:
    where = endpoint()
    with router(where):
        assert meet(WAYS[first](where), WAYS[second](where))


@pytest.mark.parametrize("sensor", WAYS)
@pytest.mark.parametrize("tool", WAYS)
def test_all_that_only_connect_to_the_daemon_meet(sensor: str, tool: str) -> None:
    where = endpoint()
    with open_session(ZenohEndpoints(listen=(where,))):
        assert meet(WAYS[sensor](where), WAYS[tool](where))


def test_a_client_waits_for_a_router_that_starts_a_little_later() -> None:
    where, over = endpoint(), threading.Event()

    def start_late() -> None:
        time.sleep(0.5)
        with router(where):
            over.wait(10.0)

    late = threading.Thread(target=start_late)
    late.start()
    try:
        assert meet(WAYS["client"](where), WAYS["client"](where))
    finally:
        over.set()
        late.join()


def test_a_client_without_a_router_gives_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onboard.zenoh_session._CLIENT_PATIENCE_MS", 300)
    where = endpoint()
    with (
        pytest.raises(zenoh.ZError, match=r"[Uu]nable to connect"),
        open_session(WAYS["client"](where)),
    ):
        pass


@pytest.mark.parametrize(("password", "admitted"), [("right", True), ("wrong", False)])
def test_user_and_password_are_passed_through(
    tmp_path: Path, password: str, *, admitted: bool
) -> None:
    where = endpoint()
    users = tmp_path / "users.txt"
    users.write_text("sensor:right\n")
    (tmp_path / "bus.yaml").write_text("zenoh: {config_file: zenoh.json5}\n")
    (tmp_path / "zenoh.json5").write_text(
        f"""{{
          mode: "client",  // Zenoh's own comments too
          connect: {{ endpoints: ["{where}"] }},
          scouting: {{ multicast: {{ enabled: false }} }},
          transport: {{ auth: {{ usrpwd: {{ user: "sensor", password: "{password}" }} }} }},
        }}"""
    )
    (tmp_path / "tool.yaml").write_text("config_file: zenoh.json5\n")
    with router(where, **{"transport/auth/usrpwd/dictionary_file": str(users)}):
        joining = load_bus(tmp_path / "tool.yaml")
        if admitted:
            assert meet(joining, joining)
        else:
            with pytest.raises(zenoh.ZError), open_session(joining):
                pass


@pytest.mark.parametrize(
    ("document", "reason"),
    [
        ({"mode": "router"}, "mode = 'router'"),
        (
            {"mode": "client", "listen": ["tcp/[::]:7447"]},
            "a client cannot listen (listen: tcp/[::]",
        ),
        ({"config_file": "z.json5", "connect": ["tcp/h:1"]}, "leave connect out"),
        ({"config_file": "z.json5", "listen": ["tcp/h:1"]}, "leave listen out"),
        ({"config_file": "z.json5", "mode": "client"}, "leave mode out"),
        ({"user": "me"}, "user is not a known key"),
    ],
)
def test_keys_that_do_not_fit_are_refused(document: dict[str, Any], reason: str) -> None:
    with pytest.raises(FileError) as refused:
        validate(document, ZenohEndpoints, source="bus.yaml")
    assert reason in str(refused.value)


def test_what_is_dumped_is_read_again() -> None:
    for endpoints in (
        ZenohEndpoints(mode="client", connect=("tcp/h:1",)),
        ZenohEndpoints(config_file=Path("zenoh.json5")),
    ):
        again = validate(endpoints.model_dump(mode="json"), ZenohEndpoints, source="here")
        assert again == endpoints


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "No such file"),
        ("{ mode: ", "expected array, boolean"),
        ('{ "mode": "spectator" }', ""),
        ("{ no_such_key: 1 }", ""),
    ],
)
def test_a_zenoh_file_that_cannot_be_used_is_one_line(
    tmp_path: Path, text: str | None, reason: str
) -> None:
    path = tmp_path / "zenoh.json5"
    if text is not None:
        path.write_text(text)
    with (
        pytest.raises(FileError) as refused,
        open_session(ZenohEndpoints(config_file=path)),
    ):
        pass
    message = str(refused.value)
    assert message.startswith(f"{path}: not a Zenoh configuration: ")
    assert reason in message
    assert "\n" not in message
    assert ".cargo" not in message


def test_paths_are_relative_to_the_file_that_names_them(tmp_path: Path) -> None:
    (tmp_path / "bus.yaml").write_text("config_file: keys/zenoh.json5\n")
    assert load_bus(tmp_path / "bus.yaml").config_file == tmp_path / "keys/zenoh.json5"
    (tmp_path / "sitl.yaml").write_text("zenoh: {config_file: zenoh.json5, listen: []}\n")
    with pytest.raises(FileError, match="leave listen out"):
        load_sitl_config(tmp_path / "sitl.yaml")
    (tmp_path / "sitl.yaml").write_text("zenoh: {config_file: zenoh.json5}\n")
    assert load_sitl_config(tmp_path / "sitl.yaml").zenoh.config_file == tmp_path / "zenoh.json5"


def test_the_daemons_own_zenoh_file_is_not_the_operators(tmp_path: Path) -> None:
    path = tmp_path / "onboard.yaml"
    path.write_text("{contract: c.yaml, mission: m.yaml, zenoh: {config_file: zenoh.json5}}\n")
    with pytest.raises(FileError, match="give yours by --zenoh-config"):
        bus_of(None, path)
    path.write_text("{contract: c, mission: m, zenoh: {mode: client, connect: [tcp/h:1]}}\n")
    assert bus_of(None, path).mode == "client"


def test_what_was_published_before_is_heard_by_who_asks_for_history() -> None:
    """Static transforms of ROS 2 are sent once, when the robot starts."""
    address, heard = endpoint(), queue.Queue[bytes]()
    with open_session(ZenohEndpoints(listen=(address,))) as ros:
        cache = zenoh.ext.CacheConfig(max_samples=1)
        late = zenoh.ext.declare_advanced_publisher(
            ros,
            "0/tf_static/x",
            cache=cache,
            sample_miss_detection=zenoh.ext.MissDetectionConfig(
                heartbeat=None, sporadic_heartbeat=None
            ),
            publisher_detection=True,
        )
        late.put(b"mounted")
        with open_session(ZenohEndpoints(connect=(address,))) as daemon:
            subscribe_with_history(
                daemon, "0/tf_static/**", lambda sample: heard.put(sample.payload.to_bytes())
            )
            gc.collect()  # no reference is kept
            assert heard.get(timeout=20.0) == b"mounted"
            late.put(b"again")
            assert heard.get(timeout=20.0) == b"again"


EXAMPLES = sorted((Path(__file__).parents[2] / "config" / "zenoh").glob("*.json5"))


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_of_users_and_tls_load_and_scout_nothing(path: Path) -> None:
    config = _configuration(ZenohEndpoints(config_file=path))
    assert config.get_json("scouting/multicast/enabled") == "false"
    link, auth = config.get_json("transport/link/tls"), config.get_json("transport/auth/usrpwd")
    assert ('"enable_mtls":true' in link) is ("mtls" in path.stem)
    assert ("change me" in auth) is ("users" in path.stem)


def test_both_sides_of_mtls_meet_and_who_has_no_certificate_does_not(tmp_path: Path) -> None:
    authority = issue(tmp_path, "ca")
    issue(tmp_path, "localhost", signed_by="ca")
    issue(tmp_path, "operator", signed_by="ca")
    where = endpoint().replace("tcp/127.0.0.1", "tls/localhost")
    document: dict[str, Any] = {
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/root_ca_certificate": str(authority),
    }
    daemon = document | {
        "transport/link/tls/listen_certificate": str(tmp_path / "localhost.pem"),
        "transport/link/tls/listen_private_key": str(tmp_path / "localhost.key"),
    }
    operator = {**document, "mode": "client", "connect/endpoints": [where]}
    stranger = operator | {"transport/link/tls/enable_mtls": False}
    operator |= {
        "transport/link/tls/connect_certificate": str(tmp_path / "operator.pem"),
        "transport/link/tls/connect_private_key": str(tmp_path / "operator.key"),
    }
    with router(where, **daemon):
        for name, settings in (("operator", operator), ("stranger", stranger)):
            config = zenoh.Config()
            for key, value in {**settings, "connect/timeout_ms": 1000}.items():
                config.insert_json5(key, json.dumps(value))
            (tmp_path / f"{name}.json5").write_text(str(config))
        joining = ZenohEndpoints(config_file=tmp_path / "operator.json5")
        assert meet(joining, joining)
        with (
            pytest.raises(zenoh.ZError),
            open_session(ZenohEndpoints(config_file=tmp_path / "stranger.json5")),
        ):
            pass


def issue(directory: Path, name: str, signed_by: str | None = None) -> Path:
    """Make a key and a certificate for a name with OpenSSL; return the certificate."""
    certificate, key = directory / f"{name}.pem", directory / f"{name}.key"
    extension = "basicConstraints=critical,CA:TRUE"
    if signed_by is not None:
        extension = f"subjectAltName=DNS:{name}"
    command = [
        *("openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"),
        *("-nodes", "-days", "1", "-subj", f"/CN={name}", "-addext", extension),
        *("-keyout", str(key), "-out", str(certificate)),
    ]
    if signed_by is not None:
        authority = directory / f"{signed_by}.pem"
        command += ["-CA", str(authority), "-CAkey", str(authority.with_suffix(".key"))]
        command += ["-addext", "basicConstraints=critical,CA:FALSE"]
    subprocess.run(command, check=True, capture_output=True)
    return certificate


def test_without_endpoints_nothing_listens_beyond_this_computer() -> None:
    before = listening()
    with open_session(ZenohEndpoints()):
        opened = listening() - before
    assert opened
    # Big-endian words of the addresses 127.0.0.1 and, of scouting, 224.0.0.224 on loopback.
    assert {address for address, _ in opened if address != "00000000"} <= {"0100007F", "E00000E0"}
    assert not [each for each in opened if each == ("00000000", "tcp")]


def listening() -> set[tuple[str, str]]:
    """Return address and protocol of the sockets of this process that take what comes."""
    own = {str(each.readlink()) for each in Path("/proc/self/fd").iterdir() if each.is_symlink()}
    found = set()
    for protocol, state in (("tcp", "0A"), ("udp", "07"), ("tcp6", "0A"), ("udp6", "07")):
        for line in Path(f"/proc/self/net/{protocol}").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] == state and f"socket:[{fields[9]}]" in own:
                found.add((fields[1].partition(":")[0], protocol))
    return found
