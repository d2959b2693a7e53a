"""Writes a command's document: as a table for people, as JSON or CSV for programs."""

from __future__ import annotations

import csv
import io
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from gcs_tools.console.errors import CommandError

Format = Literal["table", "json", "csv"]

# Width of tables where the output is not a terminal, so that files are the same everywhere.
_FILE_WIDTH = 110


def write_document(
    document: dict[str, Any],
    table: Callable[[Console], None],
    *,
    form: Format,
    path: Path | None,
) -> None:
    """Write a document to ``path``, or to standard output without one.

    Args:
        document: content for ``json`` and ``csv``.
        table: prints the same content for people.
        form: of the output.
        path: file to write; None for standard output.

    Raises:
        CommandError: the file cannot be written.
    """
    if form == "table" and path is None and sys.stdout.isatty():
        table(Console(highlight=False))
        return
    ascii_only = path is None and not _is_unicode(sys.stdout.encoding)
    write_text(_rendered(document, table, form, ascii_only=ascii_only), path)


def write_text(text: str, path: Path | None) -> None:
    """Write a text to ``path``, or to standard output without one.

    Raises:
        CommandError: the file cannot be written.
    """
    if path is None:
        sys.stdout.write(text)
        return
    try:
        path.write_text(text, encoding="utf-8", errors="replace")
    except OSError as error:
        raise CommandError(f"{path}: cannot be written: {error.strerror or error}") from error


def _is_unicode(encoding: str | None) -> bool:
    return encoding is None or encoding.lower().startswith("utf")


def _rendered(
    document: dict[str, Any], table: Callable[[Console], None], form: Format, *, ascii_only: bool
) -> str:
    if form == "json":
        return json.dumps(document, indent=2, ensure_ascii=ascii_only) + "\n"
    text = io.StringIO()
    if form == "csv":
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(("key", "value"))
        writer.writerows(_flattened(document))
    else:
        table(Console(file=text, width=_FILE_WIDTH, highlight=False))
    return text.getvalue()


def _flattened(value: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield (dotted key, value); items of a list are named by their ``name``, or numbered.

    Values are formatted as in JSON, so that a key has the same value in both forms.
    """
    if isinstance(value, dict):
        for key, item in value.items():
            yield from _flattened(item, f"{prefix}.{key}" if prefix else key)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            name = item.get("name", index) if isinstance(item, dict) else index
            yield from _flattened(item, f"{prefix}.{name}")
    else:
        yield prefix, value if isinstance(value, str) else json.dumps(value)
