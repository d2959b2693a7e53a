"""`make docs` builds pages and API without a warning; `pre-commit` checks as `make lint` does."""

import importlib.util
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest
import yaml

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("docs_hooks", ROOT / "docs" / "hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_site_builds_without_a_warning(hooks: ModuleType, tmp_path: Path) -> None:
    """One test for all that needs the site, so that parallel tests build it once."""
    done = subprocess.run(
        [BIN / "mkdocs", "build", "--strict", "--site-dir", tmp_path],
        cwd=ROOT,
        env={"NO_MKDOCS_2_WARNING": "1", "PATH": str(BIN)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    check_every_page_is_there(tmp_path, hooks)
    check_the_api_shows_what_is_public(tmp_path)
    check_no_server_is_asked_for_anything(tmp_path)


def check_every_page_is_there(site: Path, hooks: ModuleType) -> None:
    pages = {path.name for path in (ROOT / "docs").glob("*.md")}
    pages |= {*hooks.PAGES.values(), *hooks.api_pages()}
    for page in pages:
        where = site / page.removesuffix("index.md").removesuffix(".md") / "index.html"
        assert where.is_file(), page


def check_the_api_shows_what_is_public(site: Path) -> None:
    page = (site / "api" / "onboard.planning" / "index.html").read_text(encoding="utf-8")
    assert 'id="onboard.planning.planner.Planner.plan"' in page
    assert "_plan_to_brake" not in page


def check_no_server_is_asked_for_anything(site: Path) -> None:
    loaded = re.compile(r'(?:src|href)="(https?://[^"]+)"[^>]*(?:rel="stylesheet"|></script>)')
    for path in site.rglob("*.html"):
        assert loaded.findall(path.read_text(encoding="utf-8")) == [], path


@pytest.mark.parametrize(
    ("directory", "written", "linked"),
    [
        (".", "[a](docs/position.md)", "[a](position.md)"),
        (".", "[a](docs/vehicles.md#4-publish)", "[a](vehicles.md#4-publish)"),
        (".", "![a](docs/flight.png)", "![a](flight.png)"),
        ("docs", "[a](../README.md#files)", "[a](index.md#files)"),
        ("docs", "[a](../onboard/contract/THEORY.md)", "[a](theory.md)"),
        ("docs", "[a](realism.md), [b](#here)", "[a](realism.md), [b](#here)"),
        (".", "[a](https://example.org/docs/x.md)", "[a](https://example.org/docs/x.md)"),
        ("docs", "[a](../../elsewhere.md)", "a"),
        (".", "[examples/](examples)", "examples/"),
    ],
)
def test_links_lead_from_page_to_page(
    hooks: ModuleType, directory: str, written: str, linked: str
) -> None:
    assert hooks.linked(written, Path(directory)) == linked


def test_every_module_is_on_an_api_page(hooks: ModuleType) -> None:
    shown = set(re.findall(r"^::: (\S+)$", "\n".join(hooks.api_pages().values()), re.MULTILINE))
    for package in hooks.PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            parts = path.relative_to(ROOT).with_suffix("").parts
            if parts[-1] != "__main__":
                assert ".".join(parts).removesuffix(".__init__") in shown


def test_pre_commit_checks_what_make_lint_checks() -> None:
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    (repository,) = config["repos"]
    assert repository["repo"] == "local"  # it downloads nothing
    hooks = [hook["entry"] for hook in repository["hooks"]]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    (recipe,) = re.findall(r"^lint: .*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    files_named = {"ruff format --check .": "ruff format", "ruff check .": "ruff check"}
    wanted = [line.strip().removeprefix("$(BIN)/") for line in recipe.splitlines()]
    assert [
        entry.removeprefix(".venv/bin/").removesuffix(" --force-exclude") for entry in hooks
    ] == [files_named.get(line, line) for line in wanted]


def test_pre_commit_reads_its_configuration() -> None:
    done = subprocess.run(
        [BIN / "pre-commit", "validate-config", ROOT / ".pre-commit-config.yaml"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout
