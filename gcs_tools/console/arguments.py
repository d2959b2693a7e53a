"""Command line arguments that several commands share: number types, output options, renamed ones.

argparse names the argument and repeats the message of an `ArgumentTypeError`.  Imports nothing
heavy: every start of ``clearway`` loads it.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

PORT_MAX: Final = 65_535
# NumPy's random generators refuse seeds with more digits.
DIGITS_MAX: Final = 18


def natural(text: str) -> int:
    """Return a whole number, 0 or more.

    Raises:
        ArgumentTypeError: the text is not such a number.
    """
    if not (text.isascii() and text.isdecimal() and len(text) <= DIGITS_MAX):
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a whole number, 0 or more")
    return int(text)


def port(text: str) -> int:
    """Return the number of a UDP or TCP port; 0 lets the system choose a free one.

    Raises:
        ArgumentTypeError: the text is not a port number.
    """
    number = natural(text)
    if number > PORT_MAX:
        raise argparse.ArgumentTypeError(f"{text} is not a port from 0 to {PORT_MAX}")
    return number


def positive(text: str) -> float:
    """Return a finite number above 0.

    Raises:
        ArgumentTypeError: the text is not such a number.
    """
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def count(text: str) -> int:
    """Return a whole number, 1 or more.

    Raises:
        ArgumentTypeError: the text is not such a number.
    """
    number = natural(text)
    if not number:
        raise argparse.ArgumentTypeError("0 is not a whole number, 1 or more")
    return number


class RenamedOption(argparse.Action):
    """An option of an earlier version: refuse it with the new name, which ``const`` holds."""

    def __init__(self, option_strings: Sequence[str], dest: str, const: str) -> None:
        super().__init__(option_strings, dest, nargs=0, const=const, help=argparse.SUPPRESS)

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        _namespace: argparse.Namespace,
        _values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Refuse the option."""
        parser.error(f"{option_string} was renamed: use {self.const}")


class VersionOption(argparse.Action):
    """Print the installed version and exit; reads the package's metadata only then."""

    def __init__(self, option_strings: Sequence[str], dest: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help="print the version and exit")

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        _namespace: argparse.Namespace,
        _values: str | Sequence[Any] | None,
        _option_string: str | None = None,
    ) -> None:
        """Print it to standard output and exit with 0."""
        from importlib.metadata import version  # noqa: PLC0415  30 ms that other starts save

        print(f"{parser.prog} {version('clearway')}")
        parser.exit()


def add_operator_key(parser: argparse.ArgumentParser) -> None:
    """Add ``--operator-key``, which signs what a daemon with `operator_key_file` is sent."""
    parser.add_argument(
        "--operator-key", type=Path, metavar="F", help="sign the command: the daemon's own key file"
    )


def add_mavlink_key(parser: argparse.ArgumentParser) -> None:
    """Add ``--mavlink-key``, with which MAVLink messages to the vehicle are signed."""
    parser.add_argument(
        "--mavlink-key", type=Path, metavar="F", help="key file of a vehicle that signs MAVLink"
    )


def add_output_options(parser: argparse.ArgumentParser, *forms: str) -> None:
    """Add ``--format`` and ``-o``; the first of the forms is the default."""
    parser.add_argument(
        "--format",
        dest="form",
        choices=forms,
        default=forms[0],
        help=f"{forms[0]} for people (default); the others for programs",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="default: standard output"
    )
