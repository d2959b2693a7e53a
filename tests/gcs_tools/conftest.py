from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from gcs_tools.__main__ import main
from tests.gcs_tools.running import CONFIG, Clearway, Ran


@pytest.fixture
def clearway(capsys: pytest.CaptureFixture[str]) -> Clearway:
    """Run `clearway` in this process."""

    def run(*arguments: object) -> Ran:
        try:
            code = main([str(argument) for argument in arguments])
        except SystemExit as error:  # argparse's way of refusing
            code = int(error.code or 0)
        out, err = capsys.readouterr()
        return Ran(code, out, err)

    return run


@pytest.fixture
def config() -> Path:
    return CONFIG


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str, Any], Path]:
    """Write a document as YAML, or text as it is; return the path."""

    def write(name: str, document: Any) -> Path:
        path = tmp_path / name
        text = document if isinstance(document, str) else yaml.safe_dump(document)
        path.write_text(text, encoding="utf-8")
        return path

    return write
