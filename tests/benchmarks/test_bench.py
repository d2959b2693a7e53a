"""Every benchmark runs, at a fraction of its size."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.benchmarks.__main__ import main
from tests.benchmarks.measurement import Measurement
from tests.benchmarks.page import BEGIN, END, write_table

ROOT = Path(__file__).parents[2]


PAGE = ROOT / "docs" / "speed.md"
KEYS = {"value", "unit", "limit", "peer", "ratio", "ratio_min", "passes"}


def test_every_benchmark_runs_and_is_written_down(tmp_path: Path) -> None:
    output, page = tmp_path / "bench.json", tmp_path / "speed.md"
    shutil.copy(PAGE, page)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "tests.benchmarks", "--small"),
            "--output",
            output,
            "--page",
            page,
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    measured = json.loads(output.read_text(encoding="utf-8"))
    files = [*ROOT.glob("tests/bench_*.py"), *ROOT.glob("tests/*/bench_*.py")]
    texts = [path.read_text(encoding="utf-8") for path in files]
    live = sum(text.count("\ndef bench_") for text in texts if "\nLIVE = True" in text)
    assert len(measured) == sum(text.count("\ndef bench_") for text in texts) - live > 0
    assert done.stdout.count("\n") >= len(measured)
    for name, one in measured.items():
        assert set(one) == KEYS, name
        assert one["value"] > 0.0, name
        assert math.isfinite(one["value"]), name
    fresh, published = (limits_of(path) for path in (page, PAGE))
    assert fresh.keys() == measured.keys()
    assert fresh.items() <= published.items()  # which has those of live flights besides
    assert len(published) == len(fresh) + live


def limits_of(page: Path) -> dict[str, str]:
    """Return the limits of the table of a page, by benchmark."""
    table = page.read_text(encoding="utf-8").partition(BEGIN)[2].partition(END)[0]
    rows = [line.split(" | ") for line in table.strip().splitlines()[2:]]
    return {row[0].removeprefix("| "): row[2] for row in rows}


@pytest.mark.parametrize(
    ("measurement", "passes"),
    [
        (Measurement(2.0, "ms"), None),
        (Measurement(2.0, "ms", limit=2.0), True),
        (Measurement(2.1, "ms", limit=2.0), False),
        (Measurement(2.1, "x", limit=2.0, more_is_better=True), True),
        (Measurement(1.9, "x", limit=2.0, more_is_better=True), False),
        (Measurement(1.0, "ms", 15.0, "peer", ratio_min=15.0), True),
        (Measurement(1.0, "ms", 14.0, "peer", ratio_min=15.0), False),
        (Measurement(1.0, "ms", 20.0, "peer", limit=0.5, ratio_min=15.0), False),
    ],
)
def test_a_measurement_passes_by_its_limits(measurement: Measurement, passes: bool | None) -> None:
    assert measurement.passes is passes


def test_a_limit_that_is_missed_ends_in_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = Measurement(3.0, "ms", limit=2.0)
    monkeypatch.setattr("tests.benchmarks.__main__.collect", lambda: iter([("slow", lambda: slow)]))
    output = tmp_path / "bench.json"
    monkeypatch.setattr(sys, "argv", ["bench", "--output", str(output)])
    assert main() == 1
    assert "slow" in capsys.readouterr().err
    monkeypatch.setattr(sys, "argv", ["bench", "--only", "fast", "--output", str(output)])
    assert main() == 2


def test_a_page_without_a_table_is_refused(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"text\n{BEGIN}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="no table"):
        write_table(page, {"one": Measurement(1.0, "ms")})
