"""Every benchmark runs, at a fraction of its size."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_benchmark_runs_and_is_written_down(tmp_path: Path) -> None:
    output = tmp_path / "bench.json"
    done = subprocess.run(
        [sys.executable, "-m", "tests.benchmarks", "--small", "--output", output],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=600.0,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    measured = json.loads(output.read_text(encoding="utf-8"))
    files = [*ROOT.glob("tests/bench_*.py"), *ROOT.glob("tests/*/bench_*.py")]
    written = sum(path.read_text(encoding="utf-8").count("\ndef bench_") for path in files)
    assert len(measured) == written > 0
    assert done.stdout.count("\n") >= len(measured)
    for name, one in measured.items():
        assert set(one) == {"value", "unit", "peer", "ratio"}, name
        assert one["value"] > 0.0, name
        assert math.isfinite(one["value"]), name
