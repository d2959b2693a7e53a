"""The fuzz target on a fixed corpus; ``python -m tests.tools.fuzz_sitl`` generates new inputs."""

from __future__ import annotations

import random
import subprocess
import sys
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from tests.tools.fuzz_target import Target, framed, seeds

ROOT = Path(__file__).parents[2]
RUNS = 12_000


def mutated(corpus: list[bytes], chance: random.Random) -> bytes:
    """A corpus entry, or two of them, with some bytes changed."""
    data = bytearray(chance.choice(corpus) + chance.choice([b"", *corpus]))
    for _ in range(chance.randrange(1, 12)):
        data[chance.randrange(len(data))] = chance.choice([0, 1, 0x7F, 0x80, 0xFF, 0xFD, 0xFE])
    for _ in range(chance.randrange(4)):
        data[chance.randrange(len(data))] = chance.randrange(256)
    return bytes(data[: chance.randrange(4, len(data) + 1)])


def test_made_up_bytes_neither_crash_nor_move_a_signed_vehicle() -> None:
    chance, target, corpus = random.Random(5), Target(), list(seeds())
    for _ in range(RUNS):
        target.feed(mutated(corpus, chance))
    assert target.inputs == RUNS


def test_the_fuzzer_itself_runs() -> None:
    command = [sys.executable, "-m", "tests.tools.fuzz_sitl", "--runs", "300"]
    ran = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, timeout=120.0, check=False
    )
    assert ran.returncode == 0, ran.stderr
    assert "stat::number_of_executed_units: 3" in ran.stderr


def test_the_corpus_reaches_every_handler() -> None:
    """Frames made of the seeds are valid, so that their content reaches its handler."""
    reader = mavlink.MAVLink(None, 1, 1)
    names = set()
    for seed in seeds():
        (frame,) = framed(seed)
        names.add(reader.decode(bytearray(frame)).get_type())
    target = Target()
    assert names == set(target.handled)


def test_a_vehicle_that_is_changed_is_noticed() -> None:
    target = Target()
    target.disturb()
    inputs = [b""] * 200
    with pytest.raises(AssertionError, match="changed the vehicle"):
        any(map(target.feed, inputs))
