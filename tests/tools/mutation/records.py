"""Verdicts on mutants, written as they come, so that an interrupted run is worth something.

One line of JSON each, below ``build/mutation``.  A verdict counts as long as its file is unchanged;
one that a mutant was noticed also while tests are added, so that a second run need not repeat it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.tools.mutation.mutants import Mutant
from tests.tools.mutation.trials import FOLDER, ROOT, Verdict

Key = tuple[str, str, str]


@dataclass(frozen=True)
class Record:
    """What became of one mutant.

    Attributes:
        path, line, function, change: of the mutant.
        node, choice: which mutant of the file it is.
        digest: of the file when it was tried.
        verdict: of the tests.
        tests: how many were chosen.
    """

    path: str
    line: int
    function: str
    change: str
    node: int
    choice: int
    digest: str
    verdict: Verdict
    tests: int

    @property
    def key(self) -> Key:
        """File, function and change, as `Mutant.key`."""
        return self.path, self.function, self.change

    @property
    def identity(self) -> tuple[str, int, int]:
        """The same as `Mutant.identity`."""
        return self.path, self.node, self.choice


class Records:
    """The verdicts on the mutants of one part, the last on each.

    Args:
        file: where they are kept; created with the first.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._found: dict[tuple[str, int, int], Record] = {}
        lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
        records = [_record(line) for line in lines]
        digests = {path: _digest(path) for path in {record.path for record in records}}
        for record in records:
            if record.digest == digests[record.path]:
                self._found[record.identity] = record

    def add(self, mutant: Mutant, verdict: Verdict, tests: int) -> None:
        """Keep a verdict, in the file too."""
        record = Record(
            *(mutant.path, mutant.line, mutant.function, mutant.change, mutant.node, mutant.choice),
            *(_digest(mutant.path), verdict, tests),
        )
        self._found[record.identity] = record
        self._file.parent.mkdir(parents=True, exist_ok=True)
        with self._file.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(vars(record)) + "\n")

    def of(self, mutants: Iterable[Mutant]) -> list[Record]:
        """Return the verdicts on some mutants, as far as there are any."""
        found = (self._found.get(mutant.identity) for mutant in mutants)
        return [record for record in found if record is not None]


def _record(line: str) -> Record:
    fields = json.loads(line)
    return Record(**{**fields, "verdict": Verdict(fields["verdict"])})


def _digest(path: str) -> str:
    file = ROOT / path
    return hashlib.sha256(file.read_bytes()).hexdigest()[:16] if file.exists() else ""


@dataclass(frozen=True)
class Sample:
    """Which mutants of a part are tried."""

    part: str
    share: float = 1.0
    seed: int = 1

    def __str__(self) -> str:
        which = "" if self.share >= 1.0 else f" --share {self.share:g} --seed {self.seed}"
        return f"python -m tests.tools.mutation {self.part}{which}"


def records_of(part: str) -> Records:
    """Return what is known of a part."""
    return Records(FOLDER / f"{part}.jsonl")


def state(sample: Sample) -> None:
    """Note which sample of its part was tried last."""
    known = {each.part: each for each in samples()} | {sample.part: sample}
    FOLDER.mkdir(parents=True, exist_ok=True)
    text = json.dumps([vars(each) for each in known.values()])
    (FOLDER / "samples.json").write_text(text, encoding="utf-8")


def samples() -> list[Sample]:
    """Return the samples that were tried last, one of each part."""
    file = FOLDER / "samples.json"
    found = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
    return [Sample(**each) for each in found]


@dataclass(frozen=True)
class Tally:
    """Counts of the mutants of a file or of a part.

    Attributes:
        drawn: all of them.
        tried: those that there is a verdict on, unless a run was interrupted all of them.
        noticed: by a test.
        explained: not noticed, and the reason why no test can is stated.
        survivors: not noticed, or without a verdict, and without a reason.
    """

    drawn: int
    tried: int
    noticed: int
    explained: int
    survivors: tuple[Record, ...] = ()

    @classmethod
    def of(cls, drawn: int, records: Sequence[Record], reasons: Mapping[Key, str]) -> Tally:
        """Count the records of some mutants, of which so many were drawn."""
        missed = [record for record in records if record.verdict is not Verdict.NOTICED]
        survivors = tuple(record for record in missed if record.key not in reasons)
        noticed = len(records) - len(missed)
        return cls(drawn, len(records), noticed, len(missed) - len(survivors), survivors)

    @classmethod
    def together(cls, tallies: Iterable[Tally]) -> Tally:
        """Return the counts of several files."""
        each = list(tallies)
        return cls(
            sum(tally.drawn for tally in each),
            sum(tally.tried for tally in each),
            sum(tally.noticed for tally in each),
            sum(tally.explained for tally in each),
            tuple(record for tally in each for record in tally.survivors),
        )

    @property
    def score(self) -> float:
        """Share noticed of those that can be."""
        possible = self.tried - self.explained
        return self.noticed / possible if possible else 1.0

    def __str__(self) -> str:
        left = "" if self.tried == self.drawn else f" ({self.drawn - self.tried} not tried)"
        return (
            f"{self.noticed} of {self.tried} mutants noticed{left}, {self.explained} cannot be,"
            f" {len(self.survivors)} survive: {100.0 * self.score:.1f} %"
        )
