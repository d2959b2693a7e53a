"""Limits of the code's structure; ``python -m tests.tools.structure`` prints how near they are."""

import pytest

from tests.tools.detection_walk import BASE_ROOMS, DAEMON, STATIONS, Walk, walk_of_a_detection
from tests.tools.rooms_picture import draw, room_imports
from tests.tools.structure import (
    FILE_LINES_MAX,
    FUNCTION_LINES_MAX,
    PACKAGES,
    PICTURES,
    ROOM_FILES_MAX,
    ROOT,
    TESTS_PER_CODE_MIN,
    WALK_MODULES_MAX,
    arrows,
    file_lengths,
    function_lengths,
    ratio_of_tests,
    room_of,
    rooms,
    sources,
)


@pytest.fixture(scope="module")
def walk() -> Walk:
    return walk_of_a_detection()


def test_no_room_has_too_many_files() -> None:
    assert {room: files for room, files in rooms().items() if files > ROOM_FILES_MAX} == {}


def test_no_file_is_too_long() -> None:
    assert [each for each in file_lengths() if each.lines > FILE_LINES_MAX] == []


def test_no_function_is_too_long() -> None:
    assert [each for each in function_lengths() if each.lines > FUNCTION_LINES_MAX] == []


def test_there_are_enough_tests() -> None:
    assert ratio_of_tests() >= TESTS_PER_CODE_MIN


def test_every_room_says_what_it_is_for() -> None:
    for room in rooms():
        init = ROOT / room / "__init__.py"
        assert init.read_text(encoding="utf-8").startswith('"""'), room


def test_every_file_is_counted() -> None:
    counted = rooms()
    assert sum(counted.values()) == len(list(sources(*PACKAGES))) == len(file_lengths())
    assert "onboard/planning/qp" in counted
    assert any(each.name == "onboard/files/json_payload.py::parse" for each in function_lengths())


def test_room_of_a_module_and_of_a_package() -> None:
    assert room_of("onboard.planning.plan") == "onboard.planning"
    assert room_of("onboard.planning.qp.search") == "onboard.planning.qp"
    assert room_of("onboard.planning.qp") == "onboard.planning.qp"
    assert room_of("onboard") == "onboard"


def test_arrows_lead_from_room_to_room() -> None:
    found = arrows()
    assert found["onboard.contract", "onboard.geometry"] >= 1
    assert all(importer != imported for importer, imported in found)


def test_a_detection_visits_few_modules(walk: Walk) -> None:
    assert len(walk.visited) <= WALK_MODULES_MAX, walk.visited


def test_the_walk_leads_from_the_daemon_to_the_setpoint(walk: Walk) -> None:
    assert list(walk.stations) == [made for made, *_ in STATIONS]
    assert walk.visited[0] == DAEMON
    for modules in walk.stations.values():
        assert modules[0] == "onboard.autonomy"
    rooms_visited = {room_of(module) for module in walk.visited}
    assert {"onboard.perception", "onboard.guidance", "onboard.planning", "onboard.mavlink"} <= (
        rooms_visited
    )


def test_what_only_looks_at_a_detection_is_not_visited(walk: Walk) -> None:
    assert "onboard.geometry.frames" in walk.executed
    assert not any(room_of(module) in BASE_ROOMS for module in walk.visited)
    assert set(walk.visited) - {DAEMON} <= walk.executed


def test_the_architecture_page_tells_the_walk(walk: Walk) -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    missing = [module for module in walk.visited if f"`{module}`" not in page]
    assert missing == [], "docs/architecture.md, 'The walk of a detection', does not name these"


@pytest.mark.parametrize("package", PACKAGES)
def test_the_picture_of_the_rooms_is_up_to_date(package: str) -> None:
    drawn = PICTURES[package].read_text(encoding="utf-8")
    assert drawn == draw(package), "draw it anew: python -m tests.tools.structure --picture"


@pytest.mark.parametrize("package", PACKAGES)
def test_the_picture_shows_every_room(package: str) -> None:
    picture = PICTURES[package].read_text(encoding="utf-8")
    for room in room_imports(package):
        assert f">{room}/</text>" in picture or f">{room}.py</text>" in picture
