"""MAVLink FTP request by request: what a client reads, and what it is refused."""

from __future__ import annotations

import struct
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl.autopilot.protocol.files.file_transfer import (
    DATA_MAX,
    PAYLOAD_LENGTH,
    FileError,
    FileServer,
    Header,
    Operation,
    crc32,
    packed,
)

LONG = bytes(range(256)) * 50  # more than a burst
FILES = {
    "etc/extras/long.bin": lambda: LONG,
    "etc/short.txt": lambda: b"short",
    "empty.txt": lambda: b"",
}
CLIENT = (255, 190)
ACK, NAK = 128, 129


class Reader:
    """A client of a server: numbers its requests, and checks what every answer must have."""

    def __init__(self, server: FileServer | None = None, client: tuple[int, int] = CLIENT) -> None:
        self.server = FileServer(FILES) if server is None else server
        self._client = client
        self._sequence = 65_530  # wraps soon

    def ask_all(
        self, operation: int, data: bytes = b"", *, offset: int = 0, session: int = 0, size: int = 0
    ) -> list[tuple[Header, bytes]]:
        self._sequence = (self._sequence + 2) & 0xFFFF
        head = Header(self._sequence, session, operation, len(data) or size, offset=offset)
        answers = []
        for number, payload in enumerate(self.server.receive(packed(head, data), self._client)):
            header = Header.of(payload)
            assert len(payload) == PAYLOAD_LENGTH
            assert header.sequence == (self._sequence + 1 + number) & 0xFFFF
            assert header.requested == operation
            answers.append((header, payload[12 : 12 + header.size]))
        return answers

    def ask(
        self, operation: int, data: bytes = b"", *, offset: int = 0, session: int = 0, size: int = 0
    ) -> tuple[Header, bytes]:
        ((header, answer),) = self.ask_all(
            operation, data, offset=offset, session=session, size=size
        )
        return header, answer

    def refusal(self, operation: int, data: bytes = b"", *, offset: int = 0, session: int = 0,
                size: int = 0) -> FileError:  # fmt: skip
        header, answer = self.ask(operation, data, offset=offset, session=session, size=size)
        assert (header.operation, header.size) == (NAK, 1)
        return FileError(answer[0])

    def opened(self, path: bytes) -> int:
        header, answer = self.ask(Operation.OPEN_FILE_RO, path)
        assert header.operation == ACK
        size: int = struct.unpack("<I", answer)[0]
        return size


def test_a_file_is_read_in_portions_until_its_end() -> None:
    reader = Reader()
    assert reader.opened(b"/etc/extras/long.bin") == len(LONG)
    content = b""
    while len(content) < len(LONG):
        header, data = reader.ask(Operation.READ_FILE, size=DATA_MAX, offset=len(content))
        assert header.offset == len(content)
        content += data
    assert content == LONG
    end = reader.refusal(Operation.READ_FILE, size=DATA_MAX, offset=len(content))
    assert end is FileError.END_OF_FILE
    assert reader.ask(Operation.TERMINATE_SESSION)[0].operation == ACK
    assert reader.refusal(Operation.READ_FILE) is FileError.INVALID_SESSION


def test_a_read_returns_no_more_than_asked_for() -> None:
    reader = Reader()
    reader.opened(b"etc/short.txt")
    assert reader.ask(Operation.READ_FILE, size=3, offset=1)[1] == b"hor"


def test_bursts_bring_a_file_with_one_request_each() -> None:
    reader = Reader()
    reader.opened(b"etc/extras/long.bin")
    content, requests = b"", 0
    while len(content) < len(LONG):
        answers = reader.ask_all(Operation.BURST_READ_FILE, size=DATA_MAX, offset=len(content))
        requests += 1
        content += b"".join(data for _, data in answers)
        complete = [header.burst_complete for header, _ in answers]
        assert complete == [0] * (len(answers) - 1) + [1]
    assert content == LONG
    assert requests == 2
    assert reader.refusal(Operation.BURST_READ_FILE, offset=len(LONG)) is FileError.END_OF_FILE


@pytest.mark.parametrize(
    ("path", "entries"),
    [
        (b"", [b"Detc", b"Fempty.txt\t0"]),
        (b"/", [b"Detc", b"Fempty.txt\t0"]),
        (b"etc/", [b"Dextras", b"Fshort.txt\t5"]),
        (b"/etc/extras\0rest", [b"Flong.bin\t12800"]),
    ],
)
def test_a_directory_is_listed_from_an_index_on(path: bytes, entries: list[bytes]) -> None:
    reader = Reader()
    for index in range(len(entries)):
        _, listed = reader.ask(Operation.LIST_DIRECTORY, path or b"\0", offset=index)
        assert listed.split(b"\0")[:-1] == entries[index:]
    end = reader.refusal(Operation.LIST_DIRECTORY, path or b"\0", offset=len(entries))
    assert end is FileError.END_OF_FILE


def test_a_long_directory_is_listed_in_several_answers() -> None:
    names = [f"file_with_a_long_name_{number:03d}.txt" for number in range(20)]
    reader = Reader(FileServer({name: lambda: b"." for name in names}))
    listed: list[bytes] = []
    while len(listed) < len(names):
        _, data = reader.ask(Operation.LIST_DIRECTORY, b"/", offset=len(listed))
        listed += data.split(b"\0")[:-1]
    assert listed == [f"F{name}\t1".encode() for name in names]


def test_the_checksum_is_that_of_mavlink() -> None:
    _, answer = Reader().ask(Operation.CALC_FILE_CRC32, b"etc/short.txt")
    assert struct.unpack("<I", answer)[0] == crc32(b"short")
    # CRC-32 without inversion: the common one of the inverted start, inverted.
    assert crc32(b"") == 0
    assert crc32(b"\0\0\0\0") == 0
    assert crc32(b"short") != zlib.crc32(b"short")


@pytest.mark.parametrize(
    ("operation", "data", "error"),
    [
        (Operation.OPEN_FILE_RO, b"etc/none.txt", FileError.FILE_NOT_FOUND),
        (Operation.OPEN_FILE_RO, b"etc", FileError.FILE_NOT_FOUND),
        (Operation.OPEN_FILE_RO, b"\xff\xfe", FileError.FILE_NOT_FOUND),
        (Operation.LIST_DIRECTORY, b"none", FileError.FILE_NOT_FOUND),
        (Operation.CALC_FILE_CRC32, b"none", FileError.FILE_NOT_FOUND),
        (Operation.CREATE_FILE, b"new.txt", FileError.FILE_PROTECTED),
        (Operation.OPEN_FILE_WO, b"etc/short.txt", FileError.FILE_PROTECTED),
        (Operation.WRITE_FILE, b"data", FileError.FILE_PROTECTED),
        (Operation.REMOVE_FILE, b"etc/short.txt", FileError.FILE_PROTECTED),
        (Operation.RENAME, b"a\0b", FileError.FILE_PROTECTED),
        (Operation.READ_FILE, b"", FileError.INVALID_SESSION),
        (Operation.BURST_READ_FILE, b"", FileError.INVALID_SESSION),
        (Operation.TERMINATE_SESSION, b"", FileError.INVALID_SESSION),
        (99, b"", FileError.UNKNOWN_COMMAND),
    ],
)
def test_what_cannot_be_done_is_refused_by_its_reason(
    operation: int, data: bytes, error: FileError
) -> None:
    assert Reader().refusal(operation, data) is error


def test_a_size_beyond_the_data_is_refused() -> None:
    assert Reader().refusal(Operation.READ_FILE, size=240) is FileError.INVALID_DATA_SIZE


def test_a_client_has_one_session_which_a_reset_ends() -> None:
    reader = Reader()
    reader.opened(b"etc/short.txt")
    assert reader.refusal(Operation.READ_FILE, session=3) is FileError.INVALID_SESSION
    second = reader.refusal(Operation.OPEN_FILE_RO, b"empty.txt")
    assert second is FileError.NO_SESSIONS_AVAILABLE
    other = Reader(reader.server, (254, 1))
    assert other.opened(b"empty.txt") == 0
    assert reader.ask(Operation.RESET_SESSIONS)[0].operation == ACK
    assert reader.opened(b"empty.txt") == 0
    assert other.ask(Operation.TERMINATE_SESSION)[0].operation == ACK  # the reset was not its own


def test_a_repeated_request_gets_the_same_answer() -> None:
    server = FileServer(FILES)
    request = packed(Header(7, 0, Operation.OPEN_FILE_RO, 9), b"empty.txt")
    first = server.receive(request, CLIENT)
    assert server.receive(request, CLIENT) == first
    assert Header.of(first[0]).operation == ACK


def test_the_client_silent_for_longest_is_forgotten() -> None:
    reader = Reader()
    reader.opened(b"etc/short.txt")
    for system in range(1, 9):
        Reader(reader.server, (system, 1)).ask(Operation.NONE)
    assert reader.refusal(Operation.READ_FILE) is FileError.INVALID_SESSION


@given(st.lists(st.binary(max_size=260), max_size=4))
@settings(max_examples=60, deadline=None)
def test_no_bytes_break_the_server(requests: list[bytes]) -> None:
    server = FileServer(FILES)
    for request in requests:
        answers = server.receive(request, CLIENT)
        assert answers
        assert all(len(answer) == PAYLOAD_LENGTH for answer in answers)
