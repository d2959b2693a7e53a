"""MAVLink FTP, the vehicle's side, over a tree of files that can only be read.

Payloads, operations and errors are those of MAVLink's page "File Transfer Protocol".  Each client
has one session at a time, as on PX4; a request that comes again gets the same answer again.
"""

from __future__ import annotations

import enum
import struct
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

PAYLOAD_LENGTH: Final = 251
DATA_MAX: Final = 239
_HEADER = struct.Struct("<HBBBBBBI")
_ACK, _NAK = 128, 129
_SESSION = 0
_BURST_MAX = 40  # packets; the client asks for the rest
_CLIENTS_MAX = 8


class Operation(enum.IntEnum):
    """What a request asks for."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    REMOVE_FILE = 8
    CREATE_DIRECTORY = 9
    REMOVE_DIRECTORY = 10
    OPEN_FILE_WO = 11
    TRUNCATE_FILE = 12
    RENAME = 13
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15


class FileError(enum.IntEnum):
    """Why a request is refused: the first byte of a NAK's data."""

    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


class _RequestError(Exception):
    """A request that is answered by a NAK."""

    def __init__(self, error: FileError) -> None:
        self.error = error


class Header(NamedTuple):
    """The head of a payload, little-endian, before the data."""

    sequence: int
    session: int
    operation: int
    size: int
    requested: int = 0
    burst_complete: int = 0
    padding: int = 0
    offset: int = 0

    @classmethod
    def of(cls, payload: bytes) -> Header:
        """Return the head of a payload of PAYLOAD_LENGTH bytes."""
        return cls._make(_HEADER.unpack_from(payload))


def packed(header: Header, data: bytes = b"") -> bytes:
    """Return a payload of PAYLOAD_LENGTH bytes."""
    return (_HEADER.pack(*header) + data).ljust(PAYLOAD_LENGTH, b"\0")


def crc32(content: bytes) -> int:
    """Return the checksum of MAVLink FTP: CRC-32 without inversion at either end."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


@dataclass
class _Client:
    """The open file of one client, and its last request with the answers."""

    content: bytes | None = None
    request: bytes = b""
    answers: tuple[bytes, ...] = ()


class FileServer:
    """Answer the requests of any number of clients.

    Args:
        files: content by path, without a leading slash; made whenever a file is opened.
    """

    def __init__(self, files: Mapping[str, Callable[[], bytes]]) -> None:
        self._files = files
        self._clients: dict[tuple[int, int], _Client] = {}
        self._operations: dict[int, Callable[[_Client, Header, bytes], tuple[bytes, ...]]] = {
            Operation.NONE: self._nothing,
            Operation.TERMINATE_SESSION: self._terminate,
            Operation.RESET_SESSIONS: self._reset,
            Operation.LIST_DIRECTORY: self._list,
            Operation.OPEN_FILE_RO: self._open,
            Operation.READ_FILE: self._read,
            Operation.BURST_READ_FILE: self._burst,
            Operation.CALC_FILE_CRC32: self._checksum,
        }

    def content(self, path: str) -> bytes | None:
        """Return the content of a file; None if it does not exist."""
        make = self._files.get(path)
        return None if make is None else make()

    def receive(self, payload: bytes, client: tuple[int, int]) -> tuple[bytes, ...]:
        """Return the payloads that answer a request of a client (system, component)."""
        request = payload[:PAYLOAD_LENGTH].ljust(PAYLOAD_LENGTH, b"\0")
        state = self._client(client)
        if request != state.request:
            state.answers = self._answers(state, request)
            state.request = request
        return state.answers

    def _client(self, key: tuple[int, int]) -> _Client:
        state = self._clients.pop(key, None) or _Client()
        while len(self._clients) >= _CLIENTS_MAX:
            del self._clients[next(iter(self._clients))]  # the one silent for longest
        self._clients[key] = state
        return state

    def _answers(self, client: _Client, request: bytes) -> tuple[bytes, ...]:
        header = Header.of(request)
        operation = self._operations.get(header.operation, _unsupported)
        try:
            return operation(client, header, _data(header, request))
        except _RequestError as refused:
            return (_reply(header, bytes((refused.error,)), _NAK),)

    # --- operations -----------------------------------------------------------------------

    def _nothing(self, _: _Client, header: Header, __: bytes) -> tuple[bytes, ...]:
        return (_reply(header),)

    def _terminate(self, client: _Client, header: Header, _: bytes) -> tuple[bytes, ...]:
        _opened(client, header)
        client.content = None
        return (_reply(header),)

    def _reset(self, client: _Client, header: Header, _: bytes) -> tuple[bytes, ...]:
        client.content = None
        return (_reply(header),)

    def _list(self, _: _Client, header: Header, data: bytes) -> tuple[bytes, ...]:
        entries = self._entries(_path(data))
        if header.offset >= len(entries):
            raise _RequestError(FileError.END_OF_FILE)
        listed = b""
        for entry in entries[header.offset :]:
            if len(listed) + len(entry) > DATA_MAX:
                break
            listed += entry
        return (_reply(header, listed),)

    def _open(self, client: _Client, header: Header, data: bytes) -> tuple[bytes, ...]:
        content = self._existing(data)
        if client.content is not None:
            raise _RequestError(FileError.NO_SESSIONS_AVAILABLE)
        client.content = content
        return (_reply(header._replace(session=_SESSION), struct.pack("<I", len(content))),)

    def _read(self, client: _Client, header: Header, _: bytes) -> tuple[bytes, ...]:
        return (_reply(header, _portion(_opened(client, header), header)),)

    def _burst(self, client: _Client, header: Header, _: bytes) -> tuple[bytes, ...]:
        content = _opened(client, header)
        answers: list[bytes] = []
        while len(answers) < _BURST_MAX:
            data = _portion(content, header)
            following = header.offset + len(data)
            last = following >= len(content) or len(answers) == _BURST_MAX - 1
            answers.append(_reply(header._replace(burst_complete=int(last)), data))
            if last:
                break
            sequence = (header.sequence + 1) & 0xFFFF
            header = header._replace(sequence=sequence, offset=following)
        return tuple(answers)

    def _checksum(self, _: _Client, header: Header, data: bytes) -> tuple[bytes, ...]:
        return (_reply(header, struct.pack("<I", crc32(self._existing(data)))),)

    # --- files ----------------------------------------------------------------------------

    def _existing(self, data: bytes) -> bytes:
        content = self.content(_path(data))
        if content is None:
            raise _RequestError(FileError.FILE_NOT_FOUND)
        return content

    def _entries(self, directory: str) -> list[bytes]:
        """Return the entries of a directory as ListDirectory has them, in alphabetical order."""
        prefix = f"{directory}/" if directory else ""
        inside = [path for path in self._files if path.startswith(prefix)]
        if not inside and directory:
            raise _RequestError(FileError.FILE_NOT_FOUND)
        entries = set()
        for path in inside:
            name, slash, _ = path[len(prefix) :].partition("/")
            size = "" if slash else f"\t{len(self._files[path]())}"
            entries.add(f"{'D' if slash else 'F'}{name}{size}\0".encode())
        return sorted(entries)


def _data(header: Header, request: bytes) -> bytes:
    if header.size > DATA_MAX:
        raise _RequestError(FileError.INVALID_DATA_SIZE)
    return request[_HEADER.size : _HEADER.size + header.size]


def _unsupported(_: _Client, header: Header, __: bytes) -> tuple[bytes, ...]:
    """Refuse what would change a file, and what does not exist."""
    known = header.operation in set(Operation)
    raise _RequestError(FileError.FILE_PROTECTED if known else FileError.UNKNOWN_COMMAND)


def _reply(header: Header, data: bytes = b"", operation: int = _ACK) -> bytes:
    """Return the answer to a request: its sequence number is the next one."""
    return packed(
        header._replace(
            sequence=(header.sequence + 1) & 0xFFFF,
            operation=operation,
            size=len(data),
            requested=header.operation,
        ),
        data,
    )


def _opened(client: _Client, header: Header) -> bytes:
    if client.content is None or header.session != _SESSION:
        raise _RequestError(FileError.INVALID_SESSION)
    return client.content


def _portion(content: bytes, header: Header) -> bytes:
    if header.offset >= len(content):
        raise _RequestError(FileError.END_OF_FILE)
    return content[header.offset : header.offset + (header.size or DATA_MAX)]


def _path(data: bytes) -> str:
    """Return the path of a request: up to the first zero byte, without slashes at its ends.

    What follows a question mark are options of ArduPilot's virtual files, which are ignored.
    """
    text = data.split(b"\0", 1)[0].decode("ascii", "replace")
    return text.partition("?")[0].strip("/")
