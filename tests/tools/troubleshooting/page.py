"""The page docs/troubleshooting.md: every report with its cause and its cure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Final, TypeVar

from gcs_tools.cures.assumptions import ASSUMPTION_CURES
from gcs_tools.cures.checks import FINDING_CURES, RULE_CURES
from gcs_tools.cures.cure import Cure
from gcs_tools.cures.reports import EVENT_CURES, REFUSAL_CURES
from gcs_tools.preflight.live.parameters import contract_demands, mission_demands
from onboard.contract.assessment import assess
from onboard.files.contract_file import load_contract
from onboard.files.mission_file import Mission
from onboard.files.yaml_file import load_yaml
from onboard.guidance.departure import RefusalKind
from onboard.mavlink.profiles.parameter_rules import ReportedParameters
from onboard.mavlink.profiles.registry import known_profiles
from tests.tools.troubleshooting.texts import sentences_in, texts_of

ROOT: Final = Path(__file__).parents[3]
PAGE: Final = ROOT / "docs" / "troubleshooting.md"
_Enum = TypeVar("_Enum", bound=StrEnum)
_CONFIG: Final = ROOT / "config"
# Texts that stand elsewhere than the refusals that pass them on: module and functions.
_PASSED_ON: Final[Mapping[StrEnum, tuple[str, ...]]] = {
    RefusalKind.PREFLIGHT: ("onboard/monitoring/flight_authorization.py", "_objection"),
    RefusalKind.FAILED: ("onboard/monitoring/resumption.py", "resume_objections"),
    RefusalKind.FLIGHT_TIME: ("onboard/monitoring/flight_time.py", "check"),
    RefusalKind.POSITION: (
        "onboard/monitoring/estimator/position_quality.py",
        *("departure_failures", "_gps_signs", "_estimator_signs", "_ratio_signs", "_silence"),
        "_unhealthy",
    ),
}
_TEXTS: Final = {
    "head": """# Troubleshooting

Search this page for the words that you read. `clearway doctor` names what is missing now, with the
same cures; `journalctl -u clearway`, the ground station and the flight's report show the texts. A
`…` stands for a number or a name.

`python -m tests.tools.troubleshooting` makes this page from the code: a test fails if the code
can report something for which it has no cure.

""",
    "refusals": """## The daemon does not depart, or does not resume

`not leaving standby: …` and `not resuming: …` list every reason.

""",
    "assumptions": """## An assumption failed

The text begins with the name: `detection_age (front): 0.35, limit 0.30 s`. The vehicle hovers,
slows down or goes on, as [responses.md](responses.md) says.

""",
    "events": """## Other events

""",
    "rules": """## The pre-flight check refuses: contract, field, mission

""",
    "findings": """## The pre-flight check refuses: vehicle, sensors, daemon

`could not be checked` counts as refused.

""",
    "parameters": """### Parameters

The demands are those of the autopilot's contract and mission in `config/`; the check prints yours.
Set a parameter in the ground station, or by `param set` in MAVProxy.

""",
}


def page() -> str:
    """Return the page's text."""
    tables = {
        "refusals": _table(("text", "cause", "cure"), _said("RefusalKind", REFUSAL_CURES)),
        "assumptions": _table(
            ("name", "cause", "cure"),
            ((f"`{each}`", *cure) for each, cure in ASSUMPTION_CURES.items()),
        ),
        "events": _table(("event", "text", "cause", "cure"), _events()),
        "rules": _named(RULE_CURES),
        "findings": _named(FINDING_CURES),
        "parameters": _table(("autopilot", "parameter", "purpose"), parameter_rows()),
    }
    return _TEXTS["head"] + "\n".join(_TEXTS[name] + table for name, table in tables.items())


def parameter_rows() -> list[tuple[str, str, str]]:
    """Return autopilot, demand and reason of every rule on parameters."""
    rows = []
    for profile in known_profiles():
        if profile.parameters is None:
            continue
        contract = load_contract(_CONFIG / f"{profile.key}_contract.yaml")
        mission = load_yaml(_CONFIG / "default_mission.yaml", Mission)
        assessment = assess(contract, mission_altitude_m=mission.altitude_m)
        nothing = ReportedParameters({}, None, complete=False)
        rules = [
            *profile.parameters.rules(contract_demands(assessment), nothing),
            *profile.parameters.fence_rules(mission_demands(assessment, mission), nothing),
        ]
        for rule in rules:
            demand = " or ".join(f"`{each}`" for each in rule.alternatives)
            rows.append((profile.name, demand, rule.reason))
    return rows


def _said(name: str, cures: Mapping[_Enum, Cure]) -> Iterable[tuple[str, ...]]:
    texts = texts_of(name)
    for member, cure in cures.items():
        said = list(texts.get(member.name, []))
        if member in _PASSED_ON:
            said += sentences_in(*_PASSED_ON[member])
        yield ("<br>".join(f"`{each}`" for each in said) or "(what it reports)", *cure)


def _events() -> Iterable[tuple[str, ...]]:
    cells = zip(EVENT_CURES, _said("EventName", EVENT_CURES), strict=True)
    return ((f"`{name}`", *cell) for name, cell in cells)


def _named(cures: Mapping[str, Cure]) -> str:
    rows = ((f"`{name}`", *cure) for name, cure in cures.items())
    return _table(("name", "cause", "cure"), rows)


def _table(head: tuple[str, ...], rows: Iterable[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "".join(f"| {' | '.join(map(_escaped, line))} |\n" for line in lines)


def _escaped(cell: str) -> str:
    return cell.replace("|", "\\|")
