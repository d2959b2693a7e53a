"""Words that CONTRIBUTING.md, "Prose", rules out, in code and pages.

Only what a search can decide; the rest is for reviews.
"""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("onboard", "sitl", "gcs_tools", "examples")
PAGES = (ROOT / "README.md", ROOT / "CHANGELOG.md", *(ROOT / "docs").glob("*.md"))
# British with -ize, as the Oxford dictionary spells.
STEMS = (
    *("author", "discret", "final", "general", "initial", "linear", "maxim", "minim", "normal"),
    *("optim", "organ", "real", "recogn", "serial", "stabil", "summar", "synchron", "util"),
)
RULED_OUT = {
    "name the subject": r"\b(?:nobody|somebody|whoever)\b",
    "write 'fix', 'satisfy'": r"\bmend(?:s|ed|ing)?\b",
    "one word: setpoint": r"\bset-points?\b",
    "spell with -ize": rf"(?<!--)\b(?:un|re)?(?:{'|'.join(STEMS)})is(?:e|ed|es|ing|ation|ations)\b",
    "check X against Y": r"\bhold\w* (?:it|ours?|them|\w+ \w+) against\b",
}


def found(pattern: str, text: str) -> Iterator[tuple[int, str]]:
    for number, line in enumerate(text.splitlines(), start=1):
        for match in re.finditer(pattern, line, re.IGNORECASE):
            yield number, match[0]


@pytest.mark.parametrize("rule", RULED_OUT)
def test_nothing_ruled_out_is_written(rule: str) -> None:
    files = [path for name in PACKAGES for path in (ROOT / name).rglob("*.py")]
    files += [*PAGES, ROOT / "onboard" / "contract" / "THEORY.md"]
    places = [
        f"{path.relative_to(ROOT)}:{number}: {words}"
        for path in sorted(files)
        for number, words in found(RULED_OUT[rule], path.read_text(encoding="utf-8"))
    ]
    assert places == [], rule


@pytest.mark.parametrize(
    ("rule", "written"),
    [
        ("name the subject", "Nobody has asked for it."),
        ("write 'fix', 'satisfy'", "to mend a clause"),
        ("one word: setpoint", "the set-points end"),
        ("spell with -ize", "an uninitialised target"),
        ("spell with -ize", "arm authorisation"),
        ("check X against Y", "to hold ours against"),
    ],
)
def test_the_rules_catch(rule: str, written: str) -> None:
    assert list(found(RULED_OUT[rule], written))


@pytest.mark.parametrize(
    "written",
    [
        "realism, otherwise, precise",
        "--authorise",
        "amend it",
        "recommend",
        "setpoint",
        "initialize",
    ],
)
def test_the_rules_allow(written: str) -> None:
    assert not any(list(found(pattern, written)) for pattern in RULED_OUT.values())
