"""constraints.txt pins exactly what the tests need."""

from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]


def needed(requirement: Requirement, found: dict[str, set[str]]) -> None:
    """Add a requirement and all that it requires, with the extras seen so far of each."""
    name = canonicalize_name(requirement.name)
    if name in found and requirement.extras <= found[name]:
        return
    found.setdefault(name, set()).update(requirement.extras)
    for text in metadata.requires(name) or []:
        further = Requirement(text)
        extras = ("", *requirement.extras)
        if further.marker is None or any(further.marker.evaluate({"extra": x}) for x in extras):
            needed(further, found)


def test_pinned_is_what_the_tests_need() -> None:
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pins = [Requirement(line) for line in lines if not line.startswith("#")]
    found: dict[str, set[str]] = {}
    needed(Requirement("clearway[dev]"), found)
    of_every_environment = {"clearway", "setuptools"}
    assert {canonicalize_name(pin.name) for pin in pins} == found.keys() - of_every_environment
    for pin in pins:
        assert pin.specifier.contains(metadata.version(pin.name), prereleases=True), pin
