"""The command over real Zenoh on loopback, against the daemon's bus and a service that answers."""

from __future__ import annotations

import asyncio
import json
import time
from typing import TYPE_CHECKING, Any

import pytest
import zenoh
from rich.console import Console

from gcs_tools.console.errors import CommandError
from gcs_tools.console.processes import free_ports
from gcs_tools.preflight.live.bus import BusConfig
from gcs_tools.resume.command import ask, print_answer, send
from onboard.authentication.operator_command import (
    CommandGate,
    CommandJournal,
    CommandKind,
    sealed,
)
from onboard.files.resume_payload import ResumeAnswer, ResumeCommand, ResumeReason
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.guidance.departure import Refusal, RefusalKind
from onboard.operator_channel import OperatorChannel
from onboard.timing import Clock
from onboard.zenoh_session import open_session

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from onboard.files.resume_payload import Command

KEY = "clearway/vehicle/resume"


class Service:
    """Answers as it is told, and counts what it was asked."""

    def __init__(self, *refusals: Refusal) -> None:
        self._refusals, self.asked = list(refusals), 0
        self.commands: list[str] = []
        self.reported: list[str] = []

    def receive_resume(self, answer: Callable[[list[Refusal]], None], command: str) -> None:
        self.asked += 1
        self.commands.append(command)
        answer(self._refusals)

    def report_refused_command(self, kind: str, reason: str, now_s: float) -> None:  # noqa: ARG002  of the service
        self.reported.append(f"{kind}: {reason}")


def served(
    service: Service,
    act: Callable[[str], Any],
    remote_access: str | None = None,
    gate: CommandGate | None = None,
) -> Any:
    """Serve the bus on loopback while something is done in another thread."""

    async def run() -> Any:
        listen = f"tcp/127.0.0.1:{free_ports(1)[0]}"
        with open_session(ZenohEndpoints(listen=(listen,))) as session:
            channel = OperatorChannel(session, "vehicle", service, Clock(), gate)  # type: ignore[arg-type]
            channel.answer_resumes(remote_access)
            return await asyncio.to_thread(act, listen)

    return asyncio.run(run())


def resume_at(
    listen: str, output: Path, command: Command = "resume", key: bytes | None = None
) -> bool:
    bus = BusConfig(vehicle="vehicle", connect=(listen,), listen=())
    return send(bus, command, key, form="json", output=output)


def test_an_accepted_command_is_confirmed(tmp_path: Path) -> None:
    service, output = Service(), tmp_path / "answer.json"
    assert served(service, lambda listen: resume_at(listen, output)) is True
    assert service.asked == 1
    assert json.loads(output.read_text()) == {"version": 1, "accepted": True, "reasons": []}


def test_the_command_to_return_goes_the_same_way(tmp_path: Path) -> None:
    service, output = Service(), tmp_path / "answer.json"
    assert served(service, lambda listen: resume_at(listen, output, "return")) is True
    assert service.commands == ["return"]


@pytest.mark.parametrize(
    ("command", "accepted", "text"),
    [
        ("resume", True, "resumed: the vehicle flies on, from standby once it is given control"),
        ("return", True, "returning: the vehicle flies back along the way flown"),
        ("return", False, "refused: the vehicle does not return\n  • flying [home]"),
    ],
)
def test_the_answer_is_printed(
    command: Command, accepted: bool, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    reasons = () if accepted else (ResumeReason(kind="no_way_back", text="flying [home]"),)
    print_answer(ResumeAnswer(accepted=accepted, reasons=reasons), command, Console())
    assert capsys.readouterr().out.strip() == text


def test_every_reason_of_a_refusal_comes_back(tmp_path: Path) -> None:
    refusals = (
        Refusal(RefusalKind.FAILED, "second_commander has failed", "second_commander"),
        Refusal(RefusalKind.MOVING, "still braking (0.4 m/s)"),
    )
    output = tmp_path / "answer.json"
    assert served(Service(*refusals), lambda listen: resume_at(listen, output)) is False
    assert json.loads(output.read_text())["reasons"] == [
        {"kind": "failed", "subject": "second_commander", "text": "second_commander has failed"},
        {"kind": "moving", "subject": "", "text": "still braking (0.4 m/s)"},
    ]


def test_where_other_computers_may_send_it_the_command_is_refused(tmp_path: Path) -> None:
    service, output = Service(), tmp_path / "answer.json"
    why = ZenohEndpoints(listen=("tcp/0.0.0.0:7447",)).remote_access
    assert served(service, lambda listen: resume_at(listen, output), why) is False
    assert service.asked == 0
    (reason,) = json.loads(output.read_text())["reasons"]
    assert reason["text"].startswith("zenoh.listen has tcp/0.0.0.0:7447 (expected a loopback")


def test_a_command_signed_with_the_operators_key_may_come_from_anywhere(tmp_path: Path) -> None:
    output, refused = tmp_path / "answer.json", "signed with another key, or altered"
    gate = CommandGate(bytes(32), "vehicle", CommandJournal())
    service, why = Service(), "zenoh.listen has another computer"
    act = lambda listen: resume_at(listen, output, key=bytes(32))  # noqa: E731  one line each
    assert served(service, act, why, gate) is True
    assert service.asked == 1
    act = lambda listen: resume_at(listen, output, key=bytes([1] * 32))  # noqa: E731
    assert served(service, act, why, gate) is False
    (reason,) = json.loads(output.read_text())["reasons"]
    assert (reason["kind"], reason["text"]) == ("authentication", refused)
    act = lambda listen: resume_at(listen, output)  # noqa: E731
    assert served(service, act, None, gate) is False
    assert service.asked == 1
    assert service.reported == [f"resume: {refused}", "resume: not signed with the operator's key"]


def test_the_command_to_return_is_inside_what_is_signed(tmp_path: Path) -> None:
    """One signed to resume cannot be made one to return; the key lets either come from anywhere."""
    key, output = bytes(32), tmp_path / "answer.json"
    service, gate = Service(), CommandGate(key, "vehicle", CommandJournal())
    act = lambda listen: resume_at(listen, output, "return", key)  # noqa: E731  one line each
    assert served(service, act, "zenoh.listen has another computer", gate) is True
    assert service.commands == ["return"]

    def alter(listen: str) -> bytes:
        resume = ResumeCommand(command="resume").model_dump_json().encode()
        kind = CommandKind.RESUME
        command = sealed(resume, key=key, vehicle="vehicle", kind=kind, now_unix_s=time.time())
        with open_session(ZenohEndpoints(connect=(listen,))) as session:
            payload = command.replace(b"resume", b"return")
            (reply,) = session.get(KEY, payload=payload, timeout=3.0)
            assert reply.ok is not None
            return reply.ok.payload.to_bytes()

    assert json.loads(served(service, alter, None, gate))["reasons"][0]["kind"] == "authentication"
    assert service.commands == ["return"]


def test_where_a_router_has_joined_the_command_is_refused(tmp_path: Path) -> None:
    """It may pass on what other computers send, whatever the daemon itself listens to."""
    service, output = Service(), tmp_path / "answer.json"

    def act(listen: str) -> bool:
        config = zenoh.Config()
        for key, value in (
            ("mode", "router"),
            ("connect/endpoints", [listen]),
            ("listen/endpoints", ["tcp/127.0.0.1:0"]),
            ("scouting/multicast/enabled", False),
        ):
            config.insert_json5(key, json.dumps(value))
        router = zenoh.open(config)
        try:
            deadline_s = time.monotonic() + 10.0
            while not router.info.peers_zid() and time.monotonic() < deadline_s:
                time.sleep(0.05)
            return resume_at(listen, output)
        finally:
            router.close()  # type: ignore[no-untyped-call]  # untyped in its own stubs

    assert served(service, act) is False
    assert service.asked == 0
    (reason,) = json.loads(output.read_text())["reasons"]
    assert reason["text"].startswith("a Zenoh router has joined")


def test_a_query_of_a_whole_tree_of_keys_is_no_command() -> None:
    service = Service()

    def query(listen: str) -> list[bytes]:
        with open_session(ZenohEndpoints(connect=(listen,))) as session:
            return [
                reply.ok.payload.to_bytes()
                for reply in session.get("clearway/**", timeout=3.0)
                if reply.ok is not None and str(reply.ok.key_expr) == KEY
            ]

    (answer,) = served(service, query)
    assert json.loads(answer)["reasons"][0]["kind"] == "malformed"
    assert service.asked == 0


def test_without_an_answer_the_command_says_so() -> None:
    def wait(listen: str) -> None:
        with open_session(ZenohEndpoints(connect=(listen,))) as session:
            ask(session, "another", timeout_s=0.3)

    with pytest.raises(CommandError, match="clearway/another/resume: no daemon answered"):
        served(Service(), wait)


class Answering:
    """A session whose daemons answer this."""

    def __init__(self, *answers: bytes) -> None:
        self._answers = answers

    def get(self, *_: object, **__: object) -> list[Any]:
        def reply(answer: bytes) -> Any:
            payload = type("Payload", (), {"to_bytes": lambda _: answer})()
            return type("Reply", (), {"ok": type("Sample", (), {"payload": payload})})

        return [reply(answer) for answer in self._answers]


@pytest.mark.parametrize(
    ("answers", "text"),
    [((b"{}",), "cannot be read: accepted"), ((b"{}", b"{}"), "2 daemons answered")],
)
def test_an_answer_that_is_none_is_an_error(answers: tuple[bytes, ...], text: str) -> None:
    session: zenoh.Session = Answering(*answers)  # type: ignore[assignment]
    with pytest.raises(CommandError, match=text):
        ask(session, "vehicle")
