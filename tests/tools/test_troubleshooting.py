"""docs/troubleshooting.md is up to date with the code; its texts are read from the code."""

from pathlib import Path

from tests.tools.troubleshooting.page import PAGE, page, parameter_rows
from tests.tools.troubleshooting.texts import check_names, sentences_in, texts_of

SOURCE = '''
def checks(situation):
    """Return several words that nothing says."""
    text = f"{1:.1f} m beside"
    yield RefusalKind.BESIDE, True, text
    text = computed()
    found = [Refusal(RefusalKind.WIND, text)]
    found += [Refusal(RefusalKind.POSITION, text) for text in elsewhere()]
    emit(Event(now_s, EventName.MERGED, Severity.WARNING, f"avoiding {a} as one"))
    name, verdict = "take-over", 1
    Finding("vehicle", name, verdict, "all is well")
    Finding("vehicle", f"{source} age", verdict, "x")
    return Rule(unknown, 1.0)
'''


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "python -m tests.tools.troubleshooting"


def test_texts_are_read_beside_the_member(tmp_path: Path) -> None:
    (tmp_path / "module.py").write_text(SOURCE, encoding="utf-8")
    where = str(tmp_path)
    refusals = {"BESIDE": ["… m beside"], "WIND": [], "POSITION": []}
    assert texts_of("RefusalKind", where) == refusals
    assert texts_of("EventName", where) == {"MERGED": ["avoiding … as one"]}
    assert {"take-over", "age", "module.py:checks"} <= check_names(where)
    assert sentences_in(where, "checks") == ["avoiding … as one", "all is well"]


def test_the_parameters_of_both_autopilots_are_on_the_page() -> None:
    autopilots = {autopilot for autopilot, *_ in parameter_rows()}
    assert autopilots == {"PX4", "ArduPilot"}
