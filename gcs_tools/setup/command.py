"""``clearway init``: writes contract, mission, field and configuration that fit together."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final, Literal

from gcs_tools.console.errors import CommandError
from gcs_tools.schemas import MODELS, schema_text

FILES: Final = Path(__file__).parent / "files"
# Files that are alike for every autopilot.
_BOTH: Final = "both"


def init(directory: Path, vehicle: Literal["px4", "ardupilot"]) -> None:
    """Write the files; where one of them exists, write none.

    Args:
        directory: created if it is missing.
        vehicle: for which autopilot.

    Raises:
        CommandError: a file exists, or cannot be written.
    """
    texts = {f"schemas/{name}.schema.json": schema_text(model) for name, model in MODELS.items()}
    for source in sorted([*(FILES / _BOTH).iterdir(), *(FILES / vehicle).iterdir()]):
        texts[source.name] = source.read_text(encoding="utf-8")
    for name in texts:
        path = directory / name
        if path.exists() or path.is_symlink():
            raise CommandError(f"{path}: exists already; nothing is overwritten or written")
    for name, text in texts.items():
        _write(directory / name, text)
    names = ", ".join(name for name in texts if "/" not in name)
    sys.stdout.write(f"{directory}: {names}, schemas\nnext: see {directory / 'README.md'}\n")


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error
