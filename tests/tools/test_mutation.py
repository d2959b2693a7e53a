"""The mutants that the tool makes, and how it puts them into code that is imported already."""

from __future__ import annotations

import ast
import re
import signal
import subprocess
import sys
from pathlib import Path

import yaml

from tests.tools.mutation.__main__ import PARTS, SCORE_MIN, SURVIVORS, drawn, stated_reasons
from tests.tools.mutation.injection import Holders, codes_of
from tests.tools.mutation.measuring import Test
from tests.tools.mutation.mutants import Mutant, mutants_of, mutated
from tests.tools.mutation.page import page
from tests.tools.mutation.records import Records, Sample, Tally
from tests.tools.mutation.trials import _NOTICED, _SURVIVED, ROOT, Verdict, _verdict

SOURCE = """
LIMIT = 1.5

def f(a, b=2.0):
    assert a > 0
    if a < b and not b:
        return min(a, b)
    return -a * LIMIT
"""


def changes() -> list[str]:
    return [mutant.change for mutant in mutants_of("f.py", SOURCE)]


def test_every_operator_is_changed_and_assertions_are_left() -> None:
    found = changes()
    assert "1.5: one more" in found
    assert "a < b: LtE" in found
    assert "a < b: Gt" in found
    assert "a < b and (not b): or" in found
    assert "not b: without its sign" in found
    assert "min(a, b): opposite" in found
    assert "-a * LIMIT: Div" in found
    assert "-a: without its sign" in found
    assert not any("a > 0" in change for change in found)


def test_a_mutant_knows_its_function_and_what_runs_it() -> None:
    mutants = {mutant.change: mutant for mutant in mutants_of("f.py", SOURCE)}
    assert mutants["-a * LIMIT: Div"].key == ("f.py", "f", "-a * LIMIT: Div")
    assert mutants["-a * LIMIT: Div"].in_function
    # The import computes a default, and a constant.
    assert not mutants["2.0: one more"].in_function
    assert not mutants["1.5: one more"].in_function
    assert mutants["a < b: LtE"].lines == (6, 6)


def test_each_change_is_one_change() -> None:
    for mutant in mutants_of("f.py", SOURCE):
        text = ast.unparse(mutated(SOURCE, mutant))
        before = ast.unparse(ast.parse(SOURCE)).splitlines()
        assert sum(a != b for a, b in zip(text.splitlines(), before, strict=True)) == 1


def test_code_is_exchanged_wherever_a_function_has_been_imported(tmp_path: Path) -> None:
    path = tmp_path / "f.py"
    namespace: dict[str, object] = {}
    exec(compile(SOURCE, str(path), "exec", dont_inherit=True), namespace)  # noqa: S102  as an import does
    held = namespace["f"]
    assert callable(held)
    assert held(4.0) == -6.0
    mutants = {mutant.change: mutant for mutant in mutants_of("f.py", SOURCE)}
    divided = mutated(SOURCE, mutants["-a * LIMIT: Div"])
    holders, codes = Holders.of([str(path)]), codes_of(path, ast.parse(SOURCE))
    assert holders.exchange(path, codes, divided)
    assert held(4.0) == -4.0 / 1.5
    constant = mutated(SOURCE, mutants["1.5: one more"])
    assert not holders.exchange(path, codes, constant)


def test_tests_are_chosen_by_the_lines_that_they_reach() -> None:
    mutant = Mutant("f.py", 0, 0, 6, (6, 7), in_function=True, function="f", change="")
    assert Test("one", 0.1, {"f.py": {2, 7}}).reaches(mutant)
    assert not Test("other", 0.1, {"f.py": {2, 8}}).reaches(mutant)
    assert not Test("elsewhere", 0.1, {"g.py": {6}}).reaches(mutant)


def test_a_fork_that_the_limit_of_processor_time_ended_has_noticed() -> None:
    assert _verdict(_NOTICED) is Verdict.NOTICED
    assert _verdict(-signal.SIGKILL) is Verdict.NOTICED
    assert _verdict(_SURVIVED) is Verdict.SURVIVED
    assert _verdict(-signal.SIGTERM) is Verdict.UNDECIDED  # it waited for something


def test_a_process_is_ended_by_its_processor_time() -> None:
    # Not by a fork of this process, which may have threads.
    program = (
        "from tests.tools.mutation.measuring import limit_own_use\n"
        "limit_own_use(0.1)\n"
        "while True: pass"
    )
    ran = subprocess.run([sys.executable, "-c", program], cwd=ROOT, timeout=60.0, check=False)
    assert ran.returncode == -signal.SIGKILL


def test_verdicts_are_kept_as_they_come_and_counted(tmp_path: Path) -> None:
    mutants = drawn(PARTS["run-on"], 0.01, seed=1)
    assert len(mutants) == 4
    file = tmp_path / "run-on.jsonl"
    verdicts = (Verdict.NOTICED, Verdict.SURVIVED, Verdict.UNDECIDED)
    for mutant, verdict in zip(mutants, verdicts, strict=False):
        Records(file).add(mutant, verdict, tests=3)
    found = Records(file).of(mutants)
    assert [record.verdict for record in found] == list(verdicts)
    # What cannot be noticed does not count; what is undecided is not noticed.
    reasons = {mutants[1].key: "equivalent"}
    tally = Tally.of(4, found, reasons)
    counts = "1 of 3 mutants noticed (1 not tried), 1 cannot be, 1 survive: 50.0 %"
    assert str(tally) == counts
    text = page({Sample("run-on", 0.01): {mutants[0].path: tally}}, reasons)
    assert "| **run-on** | 4 | 3 | 1 | 1 | 1 | 50.0 % |" in text
    assert "python -m tests.tools.mutation run-on --share 0.01 --seed 1" in text
    assert mutants[2].change.replace("|", "\\|") in text
    # The last verdict counts, and none of a file that has changed since.
    Records(file).add(mutants[2], Verdict.NOTICED, tests=4)
    assert Tally.of(4, Records(file).of(mutants), reasons).score == 1.0
    file.write_text(re.sub('"digest": "[^"]*"', '"digest": "0"', file.read_text("utf-8")))
    assert Records(file).of(mutants) == []


def test_every_part_names_files_and_tests_that_exist_and_a_sample_is_the_same_again() -> None:
    for part in PARTS.values():
        assert all((ROOT / each).is_file() for each in (*part.files, *part.tests))
    once, again = (drawn(PARTS["run-on"], 0.1, seed=1) for _ in range(2))
    assert once == again
    assert 0.0 < SCORE_MIN < 1.0


def test_reasons_are_of_mutants_that_there_are() -> None:
    """A change of the code takes its reason along."""
    files = {file for file, _, _ in stated_reasons()}
    keys = {m.key for path in files for m in mutants_of(path, (ROOT / path).read_text("utf-8"))}
    assert stated_reasons().keys() <= keys
    assert all(each["reason"] for each in yaml.safe_load(SURVIVORS.read_text("utf-8")))
