"""Shrinks a failing flight: fewer obstacles and faults, a shorter leg, rounder numbers.

Works on the content of a scenario file, so that the result replays exactly.  Greedy and
deterministic: flies every simplification, and keeps it if an oracle with a finding still has one.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from gcs_tools.campaign.flight import fly_numbered
from gcs_tools.campaign.sources import FileSource
from gcs_tools.scenario import load_scenario
from onboard.files.yaml_file import FileError, dump_document

Document = dict[str, Any]


class Shrunk(NamedTuple):
    """A failing flight, shrunk.

    Attributes:
        document: the scenario, ready for YAML.
        findings: of the oracles, one per line.
        flights: flown to find it.
    """

    document: Document
    findings: str
    flights: int


def shrink(
    document: Document, oracles: frozenset[str], seed: int, flights_max: int
) -> Shrunk | None:
    """Return the smallest scenario found; None if the document alone does not fail the same way.

    Args:
        document: content of the failing scenario's file.
        oracles: names of those with a finding.
        seed: of the simulation.
        flights_max: stop simplifying after this many.
    """
    findings = _findings(document, seed)
    if not _names(findings) & oracles:
        return None
    flights, progress = 1, True
    while progress:
        progress = False
        for candidate in _simpler(document):
            if flights >= flights_max:
                return Shrunk(document, findings, flights)
            flights += 1
            found = _findings(candidate, seed)
            if _names(found) & oracles:
                document, findings, progress = candidate, found, True
                break
    return Shrunk(document, findings, flights)


def _findings(document: Document, seed: int) -> str:
    """Fly a document as its replay will; empty if it is refused or not a scenario."""
    with TemporaryDirectory() as directory:
        path = Path(directory) / "candidate.yaml"
        path.write_text(dump_document(document), encoding="utf-8")
        try:
            scenario = load_scenario(path)
        except FileError:
            return ""
    row = fly_numbered(FileSource("shrunk.yaml", scenario), seed, 0)
    return "" if row.refused else row.findings


def _names(findings: str) -> set[str]:
    return {line.split(":", 1)[0] for line in findings.splitlines()}


def _simpler(document: Document) -> Iterator[Document]:
    """Yield simplifications, those that remove the most first."""
    for key in ("faults", "field"):
        for index in range(len(document[key])):
            if key == "faults" or len(document[key]) > 1:
                yield _without(document, key, index)
    yield from _calmer(document)
    for key in ("faults", "field", "contract"):
        rounded = _rounded(document[key])
        if rounded != document[key]:
            yield {**document, key: rounded}


def _calmer(document: Document) -> Iterator[Document]:
    """Yield the scenario without wind, without noise, without climbs, and with a shorter leg."""
    if "wind" in document["sitl"]:
        yield _changed(document, ("sitl", "wind"), None)
    for index, sensor in enumerate(document["sitl"].get("sensors", ())):
        if sensor.get("noise_m"):
            yield _changed(document, ("sitl", "sensors", index, "noise_m"), 0.0)
    if document["mission"]["climb_max_m"]:
        yield _changed(document, ("mission", "climb_max_m"), 0.0)
    end_m = document["mission"]["legs"][0]["end_ned_m"]
    shorter_m = [round(0.75 * each_m, 1) for each_m in end_m]
    if max(map(abs, end_m)) > 1.0:
        yield _changed(document, ("mission", "legs", 0, "end_ned_m"), shorter_m)


def _without(document: Document, key: str, index: int) -> Document:
    return {**document, key: [each for i, each in enumerate(document[key]) if i != index]}


def _changed(document: Document, path: tuple[str | int, ...], value: Any) -> Document:
    """Return a copy with one value changed; None removes the key."""
    changed = copy.deepcopy(document)
    place: Any = changed
    for key in path[:-1]:
        place = place[key]
    if value is None:
        del place[path[-1]]
    else:
        place[path[-1]] = value
    return changed


def _rounded(value: Any) -> Any:
    """Return a copy with every number rounded to one decimal, or to two where one gives 0."""
    match value:
        case float():
            return round(value, 1) or round(value, 2)
        case dict():
            return {key: _rounded(each) for key, each in value.items()}
        case list() | tuple():
            return [_rounded(each) for each in value]
        case _:
            return value
