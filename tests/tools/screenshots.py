"""The README's pictures: ``python -m tests.tools.screenshots`` writes ``docs/{report,watch}.png``.

The report is that of the paper's flight in virtual time; the live view is of the same flight in
real time, while it avoids an obstacle.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from gcs_tools.fly.command import fly
from tests.gcs_tools.browser import Page, chromium
from tests.gcs_tools.running import CONFIG, until
from tests.gcs_tools.watch.test_watch import running

DOCS = Path(__file__).parents[2] / "docs"
_SIZE_PX = (1280, 1180)
# In the middle of the second avoidance.
_SHOWN_S = 13.0


def picture_report(page: Page, directory: Path) -> None:
    """Fly in virtual time and show the report."""
    fly(CONFIG / "paper.yaml", virtual=True, seed=1, out=directory, fly_outside_contract=False)
    page.look_like(*_SIZE_PX)
    page.open((directory / "report.html").as_uri())
    page.evaluate(f"seek({_SHOWN_S})")
    page.screenshot(DOCS / "report.png", whole=False)


def picture_live_view(page: Page, directory: Path) -> None:
    """Fly in real time and show the page that follows."""
    onboard = directory / "onboard.yaml"
    with running("fly", "--out", str(directory)):
        until(onboard.exists, timeout_s=60.0)
        with running("watch", "--daemon-config", str(onboard), "--port", "0") as watching:
            assert watching.stdout is not None
            page.look_like(*_SIZE_PX)
            page.open(watching.stdout.readline().strip())
            page.until("document.getElementById('phase').textContent === 'AVOID'")
            page.until("Number(readout.textContent.match(/north (\\S+)/)[1]) > 20")
            page.screenshot(DOCS / "watch.png", whole=False)


def main() -> int:
    """Take both pictures."""
    with tempfile.TemporaryDirectory() as name, chromium(Path(name) / "profile") as page:
        picture_report(page, Path(name) / "paper-1")
        picture_live_view(page, Path(name) / "live")
        sys.stderr.writelines(f"{complaint}\n" for complaint in page.complaints)
        return 1 if page.complaints else 0


if __name__ == "__main__":
    sys.exit(main())
