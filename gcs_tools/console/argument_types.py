"""Types of command line arguments; argparse names the argument and repeats the sentence."""

from __future__ import annotations

import argparse
import math
from typing import Final

PORT_MAX: Final = 65_535
# Beyond this many, NumPy's random generators take no seed.
DIGITS_MAX: Final = 18


def natural(text: str) -> int:
    """Return a whole number from 0 on.

    Raises:
        ArgumentTypeError: the text is none.
    """
    if not (text.isascii() and text.isdecimal() and len(text) <= DIGITS_MAX):
        raise argparse.ArgumentTypeError(f"{text[:40]!r} is not a number from 0 on")
    return int(text)


def port(text: str) -> int:
    """Return the number of a UDP or TCP port; 0 means any that is free.

    Raises:
        ArgumentTypeError: the text is none.
    """
    number = natural(text)
    if number > PORT_MAX:
        raise argparse.ArgumentTypeError(f"{text} is not a port from 0 to {PORT_MAX}")
    return number


def positive(text: str) -> float:
    """Return a finite number above 0.

    Raises:
        ArgumentTypeError: the text is none.
    """
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def count(text: str) -> int:
    """Return a whole number from 1 on.

    Raises:
        ArgumentTypeError: the text is none.
    """
    number = natural(text)
    if not number:
        raise argparse.ArgumentTypeError("0 is not a number from 1 on")
    return number
