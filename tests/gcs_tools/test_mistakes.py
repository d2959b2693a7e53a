"""A new user's mistakes, over all commands and files: each gives one line that helps, and exit 2.

Every mistake begins in a folder of `clearway init`.  ``change`` replaces a text of a file, or the
whole file where the text to replace is empty.
"""

from __future__ import annotations

import json
import shlex
import shutil
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from gcs_tools.__main__ import build_parser
from gcs_tools.setup.command import init
from onboard.__main__ import main as onboard_main
from sitl.__main__ import main as sitl_main
from tests.gcs_tools.missions.ground_station import WAYPOINT, north, plan, simple
from tests.gcs_tools.running import Clearway

PLAN = json.dumps(plan(simple(WAYPOINT, *north(1.0))))
NO_HOME = json.dumps(plan(simple(WAYPOINT, *north(1.0)), plannedHomePosition=None))
# The slowest refuses within a second.
PATIENCE_S = 60.0
CHECK = "preflight --contract contract.yaml"
STATED = "range_m: 9.0, uncertainty_m: 0.1"
SOURCE = f"sources: [{{kind: laserscan, name: l, topic: /scan, {STATED}, mounting: "
VIRTUAL = f"kind: field_file, name: v, {STATED}"
TRAFFIC = (
    f"kind: traffic, name: t, {STATED}, messages: [adsb_vehicle], mover_class: drone, "
    "latency_s: 0.5"
)
READ_BACK = (
    f"sources: [{{kind: obstacle_distance, name: p, {STATED}}}]\n"
    "outputs: {obstacle_distance: {through_autopilot: true}}"
)


class Mistake(NamedTuple):
    """What was done wrong, and what the line has to say."""

    what: str
    command: str
    words: tuple[str, ...]
    change: tuple[str, str, str] | None = None


MISTAKES = [
    # ------------------------------------------------------------------------ the command line
    Mistake("no command", "", ("COMMAND", "--help")),
    Mistake("a command that does not exist", "takeoff", ("'takeoff'", "preflight")),
    Mistake("an option that does not exist", f"{CHECK} --altitude 5", ("--altitude",)),
    Mistake("an option without its value", "preflight --contract", ("--contract", "expected one")),
    Mistake("a file without its option", "preflight contract.yaml", ("--contract",)),
    Mistake("an old option", "fly --force", ("--force was renamed", "--fly-outside-contract")),
    Mistake("an action left out", "contract --contract contract.yaml", ("ACTION",)),
    Mistake("a seed that is no number", "fly scenario.yaml --seed first", ("--seed", "'first'")),
    Mistake("a format that is not offered", f"{CHECK} --format yaml", ("--format", "'yaml'")),
    # ------------------------------------------------------------------------ init
    Mistake("a folder that is in use", "init .", ("exists already", "nothing is overwritten")),
    Mistake("a folder that is a file", "init contract.yaml", ("contract.yaml", "be written")),
    Mistake("another autopilot", "init new --vehicle betaflight", ("betaflight", "ardupilot")),
    # ------------------------------------------------------------------------ keys
    Mistake(
        "a key for nothing to sign",
        "preflight --contract contract.yaml --mavlink-key contract.yaml",
        ("--mavlink-key needs --vehicle",),
    ),
    Mistake(
        "an operator's key without a daemon",
        "preflight --contract contract.yaml --operator-key contract.yaml",
        ("--operator-key needs --zenoh-config",),
    ),
    Mistake(
        "a key that everybody reads",
        "resume --zenoh-config bus.yaml --operator-key contract.yaml",
        ("contract.yaml: mode", "lets other users"),
    ),
    # ------------------------------------------------------------------------ contract file
    Mistake("a file that is not there", "preflight --contract contact.yaml", ("No such file",)),
    Mistake("a folder for a file", "preflight --contract schemas", ("schemas", "directory")),
    Mistake("another kind of file", "preflight --contract mission.yaml", ("not a known key",)),
    Mistake(
        "a misspelt key", CHECK, ("raduis_m", "not a known key"),
        ("contract.yaml", "  radius_m:", "  raduis_m:"),
    ),
    Mistake(
        "a unit in a number", CHECK, ("cruise_speed_mps [m/s]", "'2.8 m/s'"),
        ("contract.yaml", "cruise_speed_mps: 2.8\n", "cruise_speed_mps: 2.8 m/s\n"),
    ),
    Mistake(
        "a decimal comma", CHECK, ("radius_m [m]", "'0,40'"),
        ("contract.yaml", "radius_m: 0.40", "radius_m: 0,40"),
    ),
    Mistake(
        "a number in quotes", CHECK, ("radius_m [m]", "'0.40'"),
        ("contract.yaml", "radius_m: 0.40", "radius_m: '0.40'"),
    ),
    Mistake(
        "a tilt in radians", f"{CHECK} --set vehicle.roll_max_deg=95", ("roll_max_deg", "90"),
    ),
    Mistake(
        "a key left out", CHECK, ("detection_range_m [m] is missing",),
        ("contract.yaml", "  detection_range_m: 15.0\n", ""),
    ),
    Mistake(
        "a key twice", CHECK, ("'radius_m' is given twice",),
        ("contract.yaml", "  radius_m:", "  radius_m: 0.4\n  radius_m:"),
    ),
    Mistake(
        "a tab for spaces", CHECK, ("contract.yaml", "not valid YAML"),
        ("contract.yaml", "  radius_m:", "\tradius_m:"),
    ),
    Mistake(
        "indentation lost", CHECK, ("not valid YAML", "line 1"),
        ("contract.yaml", "  radius_m:", "radius_m:"),
    ),
    Mistake(
        "a least size above the greatest", CHECK, ("obstacle_size_min_m", "exceeds"),
        ("contract.yaml", "obstacle_size_min_m: 0.0", "obstacle_size_min_m: 5.0"),
    ),
    Mistake("an empty file", CHECK, ("contract.yaml", "expected keys"), ("contract.yaml", "", "")),
    Mistake(
        "a faster cruise than was measured", f"{CHECK} --set vehicle.cruise_speed_mps=4",
        ("setpoint_loss_run_on_speed_mps", "measure"),
    ),
    Mistake("an override without a value", f"{CHECK} --set vehicle.radius_m", ("key=value",)),
    Mistake(
        "an override of no key", f"{CHECK} --set radius_m=0.4", ("radius_m", "not a known key")
    ),
    Mistake(
        "a key that cannot be solved for",
        "contract solve --contract contract.yaml --for cruise_speed",
        ("cruise_speed", "vehicle.cruise_speed_mps"),
    ),
    Mistake(
        "a picture of no known kind",
        "contract surface --contract contract.yaml --figure 11 --plot surface.doc",
        ("surface.doc",),
    ),
    # ------------------------------------------------------------------------ mission file
    Mistake(
        "a mission without legs", f"{CHECK} --mission mission.yaml", ("legs",),
        ("mission.yaml", "", "altitude_m: 5.0\nlegs: []\n"),
    ),
    Mistake(
        "an altitude below the ground", f"{CHECK} --mission mission.yaml", ("altitude_m [m] = -5",),
        ("mission.yaml", "altitude_m: 5.0", "altitude_m: -5.0"),
    ),
    Mistake(
        "latitude and longitude in a mission", f"{CHECK} --mission mission.yaml",
        ("not a known key",), ("mission.yaml", "", "latitude: 47.39\nlongitude: 8.54\n"),
    ),
    Mistake(
        "map coordinates in a mission", f"{CHECK} --mission mission.yaml", ("end_ned_m", "100000"),
        ("mission.yaml", "[115.0, 0.0]", "[5249465.0, 465710.0]"),
    ),
    Mistake(
        "three numbers for a place", f"{CHECK} --mission mission.yaml", ("end_ned_m",),
        ("mission.yaml", "[115.0, 0.0]", "[115.0, 0.0, -5.0]"),
    ),
    Mistake(
        "a leg to where it begins", f"{CHECK} --mission mission.yaml", ("end_ned_m", "less than"),
        ("mission.yaml", "[115.0, 0.0]", "[0.0, 0.0]"),
    ),
    Mistake(
        "a landing at the end", f"{CHECK} --mission mission.yaml", ("on_end", "hover", "return"),
        ("mission.yaml", "altitude_m: 5.0", "altitude_m: 5.0\non_end: land"),
    ),
    Mistake(
        "a reserve in percent", f"{CHECK} --mission mission.yaml", ("reserve_fraction", "25"),
        ("mission.yaml", "altitude_m: 5.0",
         "altitude_m: 5.0\nenergy: {reserve_fraction: 25.0, endurance_s: 900.0}"),
    ),
    Mistake("return without a daemon", "return", ("--zenoh-config", "--daemon-config")),
    Mistake("a plan for a mission", f"{CHECK} --mission a.plan", ("a.plan",), ("a.plan", "", PLAN)),
    # ------------------------------------------------------------------------ obstacle field
    Mistake(
        "an empty field", f"{CHECK} --field field.yaml", ("at least one obstacle",),
        ("field.yaml", "", "[]\n"),
    ),
    Mistake(
        "two obstacles of one name", f"{CHECK} --field field.yaml", ("two obstacles", "'shed'"),
        ("field.yaml", '"tank"', '"shed"'),
    ),
    Mistake(
        "an obstacle without a size", f"{CHECK} --field field.yaml", ("size_m [m] is missing",),
        ("field.yaml", ", size_m: [1.2, 1.6]", ""),
    ),
    Mistake(
        "a stem map with other columns", f"{CHECK} --field trees.csv",
        ("has 0 columns x_m", "clearway mission stems"),
        ("trees.csv", "", "easting,northing,dbh\n465710,5249465,30\n"),
    ),
    Mistake(
        "a stem map in UTM", f"{CHECK} --field trees.csv", ("km from the mission's origin",),
        ("trees.csv", "", "x_m,y_m,dbh_cm\n5249465,465710,30\n"),
    ),
    Mistake(
        "a stem map with decimal commas", f"{CHECK} --field trees.csv", ("semicolons",),
        ("trees.csv", "", "x_m,y_m,dbh_cm\n1,5,2,0,30,0\n"),
    ),
    Mistake(
        "a stem map in metres", f"{CHECK} --field trees.csv", ("row 2", "dbh_cm"),
        ("trees.csv", "", "x_m,y_m,dbh_cm\n1,2,thick\n"),
    ),
    Mistake("a picture without a field", f"{CHECK} --picture a.png", ("--field",)),
    Mistake(
        "a geofence without a mission", f"{CHECK} --geofence fence.yaml", ("--mission",),
        ("fence.yaml", "", "areas: [{keep: inside, center_ned_m: [0, 0], radius_m: 90}]\n"),
    ),
    # ------------------------------------------------------------------------ the live check
    Mistake("a URL without a scheme", f"{CHECK} --vehicle 127.0.0.1:14550", ("127.0.0.1:14550",)),
    Mistake("an endurance in words", f"{CHECK} --endurance '15 min'", ("--endurance", "15 min")),
    Mistake("a system id without a vehicle", f"{CHECK} --system-id 1", ("--vehicle",)),
    Mistake(
        "parameters of a plane", f"{CHECK} --parameters a.param", ("neither PX4", "save all"),
        ("a.param", "", "TECS_CLMB_MAX,5\n"),
    ),
    Mistake("authorization without a vehicle", f"{CHECK} --authorize 60", ("--vehicle",)),
    Mistake(
        "a Zenoh endpoint that is none", f"{CHECK} --zenoh-config bus.yaml", ("Zenoh session",),
        ("bus.yaml", "", "connect: [127.0.0.1]\n"),
    ),
    Mistake(
        "a client without a router", f"{CHECK} --zenoh-config bus.yaml", ("client cannot listen",),
        ("bus.yaml", "", "mode: client\nlisten: [tcp/0.0.0.0:1]\n"),
    ),
    Mistake(
        "a vehicle's name with a space", "status --zenoh-config bus.yaml", ("'my drone'",),
        ("bus.yaml", "vehicle: vehicle ", "vehicle: my drone "),
    ),
    # ------------------------------------------------------------------------ import of missions
    Mistake("neither file nor vehicle", "mission import", ("FILE", "--from-vehicle")),
    Mistake("both file and vehicle", "mission import a.plan --from-vehicle udpin://127.0.0.1:0",
            ("either FILE",)),
    Mistake("no mission to import", "mission import a.plan", ("a.plan", "No such file")),
    Mistake(
        "an action of mission left out", "mission a.plan", ("'a.plan'", "import"),
    ),
    Mistake(
        "a plan without home", "mission import a.plan", ("no home", "--home LAT,LON,ALT"),
        ("a.plan", "", NO_HOME),
    ),
    Mistake(
        "home in degrees, minutes", "mission import a.plan --home 47d23m,8d32m",
        ("--home", "LAT,LON"), ("a.plan", "", PLAN),
    ),
    Mistake(
        "longitude before latitude", "mission import a.plan --home 147.2,-35.1,5",
        ("latitude [°] = 147.2",), ("a.plan", "", PLAN),
    ),
    Mistake(
        "a KML file", "mission import a.kml", ("neither JSON", "QGC WPL 110"),
        ("a.kml", "", "<kml></kml>\n"),
    ),
    Mistake(
        "a waypoint list of another version", "mission import a.txt", ("'QGC WPL 120'",),
        ("a.txt", "", "QGC WPL 120\n"),
    ),
    Mistake(
        "a waypoint list without home", "mission import a.txt", ("not home", "--first-item"),
        ("a.txt", "", "QGC WPL 110\n0 0 3 16 0 0 0 0 47.39 8.54 10 1\n"),
    ),
    Mistake(
        "a plan over itself", "mission import a.plan -o a.plan", ("overwrite",),
        ("a.plan", "", PLAN),
    ),
    Mistake(
        "a geofence that the plan lacks", "mission import a.plan --geofence f.yaml",
        ("no geofence",), ("a.plan", "", PLAN),
    ),
    Mistake(
        "UTM without an origin", "mission stems a.csv --north N --east E --utm 32N", ("--origin",),
        ("a.csv", "", "N,E,dbh_cm\n5249465,465710,30\n"),
    ),
    Mistake(
        "a zone with its band", "mission stems a.csv --utm 32T", ("'32T'", "32N"),
        ("a.csv", "", "x_m,y_m,dbh_cm\n1,2,30\n"),
    ),
    # ------------------------------------------------------------------------ flights
    Mistake("no scenario of that name", "fly forest.yaml", ("forest.yaml", "No such file")),
    Mistake(
        "a contract for a scenario", "fly contract.yaml", ("contract.yaml", "not a known key")
    ),
    Mistake(
        "a scenario with a lost file", "fly scenario.yaml", ("field.yml", "No such file"),
        ("scenario.yaml", "field: field.yaml", "field: field.yml"),
    ),
    Mistake(
        "an autopilot's parameter misspelt", "fly scenario.yaml --virtual", ("MPC_XY_PP",),
        ("scenario.yaml", "MPC_XY_P:", "MPC_XY_PP:"),
    ),
    Mistake(
        "a fault that does not exist", "fly scenario.yaml --virtual", ("'gps_off'", "'gps_lost'"),
        ("scenario.yaml", "expect:", "faults: [{kind: gps_off, start_s: 5.0}]\nexpect:"),
    ),
    Mistake(
        "a fault in a live flight", "fly scenario.yaml", ("faults need virtual time",),
        ("scenario.yaml", "expect:", "faults: [{kind: detections_off, start_s: 30.0}]\nexpect:"),
    ),
    Mistake(
        "a start beside the mission's", "fly scenario.yaml --virtual", ("start_ned_m",),
        ("scenario.yaml", "sitl:\n", "sitl:\n  start: {position_ned_m: [9.0, 0.0, 0.0]}\n"),
    ),
    Mistake("an output that is a file", "fly scenario.yaml --virtual --out mission.yaml",
            ("mission.yaml", "cannot be written")),
    Mistake(
        "a vehicle that signs, without its key", "fly scenario.yaml", ("--mavlink-key F",),
        ("scenario.yaml", "sitl:\n", "sitl:\n  signing_passphrase: words\n"),
    ),
    Mistake("a flight signed by another file", "fly --mavlink-key contract.yaml",
            ("contract.yaml: mode", "chmod 600")),
    Mistake("a fleet of one file", "fleet check mission.yaml", ("mission.yaml", "vehicles")),
    Mistake("a flight of a mission", "fleet fly mission.yaml", ("mission.yaml", "vehicles")),
    Mistake("a network without messages", "fleet fly fleet.yaml --loss 1", ("--loss", "share")),
    Mistake("a campaign that does not exist", "campaign thorough", ("thorough", "nominal")),
    Mistake("no jobs", "campaign nominal --jobs 0", ("--jobs",)),
    Mistake("a benchmark that does not exist", "benchmark rando", ("rando", "sando")),
    Mistake("a benchmark without its scenes", "benchmark sando", ("--data PATH",)),
    Mistake(
        "no spheres of a benchmark", "benchmark dodgedrone --service --data .",
        ("no such scenes", "easy_0.csv"),
    ),
    Mistake(
        "another file for a benchmark's", "benchmark longleaf --data field.yaml",
        ("field.yaml", "x_m"),
    ),
    # ------------------------------------------------------------------------ logs
    Mistake("a report of nothing", "report flights/scenario-1", ("flights/scenario-1",)),
    Mistake("a report of another file", "report contract.yaml", ("contract.yaml",)),
    Mistake("an export without a form", "export flights/scenario-1", ("--tlog", "--foxglove")),
    Mistake("an export of nothing", "export flights/scenario-1 --tlog", ("flights/scenario-1",)),
    Mistake("identification of nothing", "identify flight.bin", ("flight.bin",)),
    Mistake("identification of a folder without logs", "identify schemas", ("schemas",)),
    Mistake("identification without logs or a flight", "identify", ("LOG", "--fly")),
    Mistake("a flight without free air", "identify --fly", ("--free-air LENGTHxWIDTH",)),
    Mistake("free air of one side", "identify --fly --free-air 60", ("'60'", "60x20")),
    Mistake("free air of a room", "identify --fly --free-air 3x3", ("'3x3'", "from 4 to 1000 m")),
    Mistake("free air without a flight", "identify a.bin --free-air 60x20", ("needs --fly",)),
    Mistake("a log for a flight", "identify a.bin --fly --free-air 60x20", ("leave out a.bin",)),
    Mistake("air that is too short", "identify --fly --free-air 20x20", ("of length are needed",)),
    Mistake("air that is too narrow", "identify --fly --free-air 80x4", ("of width are needed",)),
    Mistake(
        "an identification beyond the contract", "identify --fly --free-air 80x20 --speed 20",
        ("--speed 20 m/s", "vehicle.cruise_speed_mps"),
    ),
    Mistake("free air without a word for it", "identify --fly --free-air 90x20", ("--vouch",)),
    Mistake(
        "an identification without the daemon's file",
        "identify --fly --free-air 80x20 --daemon-config daemon.yaml", ("No such file",),
    ),
    Mistake("a replay of nothing", "replay bag", ("bag", "expected a bag's folder")),
    Mistake("a replay of a bag of ROS 1", "replay a.bag", ("a.bag", ".mcap"), ("a.bag", "", "#")),
    Mistake("a replay into a picture", "replay a.db3 -o a.png", ("a.png", ".yaml or .csv")),
    # ------------------------------------------------------------------------ sensors
    Mistake("no file of a daemon", "sensor check daemon.yaml", ("daemon.yaml", "No such file")),
    Mistake("the contract for its sensors", "sensor check contract.yaml", ("not a known key",)),
    Mistake("a time of nothing", "sensor check --for 0", ("--for", "above 0")),
    Mistake(
        "a mounting said twice", "sensor check onboard.yaml", ("tf_topic replaces x_m",),
        ("onboard.yaml", "require_preflight: false", SOURCE + "{tf_topic: /tf_static, x_m: 0.1}}]"),
    ),
    Mistake(
        "a map that is read back", f"{CHECK} --daemon-config onboard.yaml", ("read it back",),
        ("onboard.yaml", "require_preflight: false", READ_BACK),
    ),
    Mistake(
        "virtual obstacles beside a real sensor", f"{CHECK} --daemon-config onboard.yaml",
        ("beside the real sensor 'p'", "beside_real_sensors"),
        ("onboard.yaml", "require_preflight: false",
         f"sources: [{{{VIRTUAL}, field: f.yaml}}, {{kind: range, name: p, topic: r, {STATED}}}]"),
    ),
    Mistake(
        "virtual obstacles of a file that is lost", "clearway-onboard --config onboard.yaml",
        ("wood.yaml", "No such file"),
        ("onboard.yaml", "require_preflight: false", f"sources: [{{{VIRTUAL}, field: wood.yaml}}]"),
    ),
    Mistake(
        "other vehicles without movers", f"{CHECK} --daemon-config onboard.yaml",
        ("onboard.yaml: sources: 't' (traffic) tells of movers only", "movers = none"),
        ("onboard.yaml", "require_preflight: false", f"sources: [{{{TRAFFIC}, accuracy_m: 9.0}}]"),
    ),
    Mistake(
        "a tracker without movers", "clearway-onboard --config onboard.yaml",
        ("onboard.yaml: sources: 'o' (tracked_objects) tells of movers only", "remove it"),
        ("onboard.yaml", "require_preflight: false",
         f"sources: [{{kind: tracked_objects, name: o, topic: o, objects_frame: body, {STATED}}}]"),
    ),
    Mistake(
        "other vehicles of no accuracy", "clearway-onboard --config onboard.yaml",
        ("onboard.yaml", "accuracy_m: needed for adsb_vehicle"),
        ("onboard.yaml", "require_preflight: false", f"sources: [{{{TRAFFIC}}}]"),
    ),
    # ------------------------------------------------------------------------ live view, service
    Mistake("a port that is none", "watch --port 80000", ("--port", "80000")),
    Mistake("two ways to the daemon", "watch --zenoh-config a --daemon-config b", ("not allowed",)),
    Mistake("two ways to resume", "resume --daemon-config a --zenoh-config b", ("not allowed",)),
    Mistake("the contract for the daemon's file", "doctor --daemon-config contract.yaml",
            ("contract.yaml", "not a known key")),
    Mistake("the operator's file", "status --daemon-config bus.yaml", ("bus.yaml", "connect")),
    Mistake(
        "a daemon's file with a lost mission", "doctor --daemon-config onboard.yaml",
        ("plan.yaml", "No such file"), ("onboard.yaml", "mission: mission", "mission: plan"),
    ),
    Mistake("a vehicle's id without it", "doctor --daemon-config onboard.yaml --system-id 2",
            ("--vehicle",)),
    Mistake("a service without its file", "service install", ("/etc/clearway/onboard.yaml",)),
    Mistake(
        "a service of no user",
        "service install --daemon-config onboard.yaml --user no-one-here", ("useradd",),
    ),
    Mistake("schemas without a place", "schema", ("--output",)),
    # ------------------------------------------------------------------------ the processes
    Mistake("no daemon's file", "clearway-onboard --config daemon.yaml", ("No such file",)),
    Mistake(
        "a geofence that is not there", "clearway-onboard --config onboard.yaml",
        ("fence.yaml", "No such file"),
        ("onboard.yaml", "require_preflight: false", "geofence: fence.yaml"),
    ),
    Mistake(
        "a link without a scheme", "clearway-onboard --config onboard.yaml", ("/dev/ttyAMA0",),
        ("onboard.yaml", "url: udpin://127.0.0.1:14540", "url: /dev/ttyAMA0:57600"),
    ),
    Mistake(
        "a device that is no serial port", "clearway-onboard --config onboard.yaml",
        ("serial:///dev/null:57600", "not a serial device"),
        ("onboard.yaml", "url: udpin://127.0.0.1:14540", "url: serial:///dev/null:57600"),
    ),
    Mistake(
        "a system id of 0", "clearway-onboard --config onboard.yaml", ("mavlink.system_id = 0",),
        ("onboard.yaml", "system_id: 1", "system_id: 0"),
    ),
    Mistake(
        "an old key", "clearway-onboard --config onboard.yaml", ("accept_mission_updates",),
        ("onboard.yaml", "require_preflight: false", "mission_changes: true"),
    ),
    Mistake(
        "a quota below one log", "clearway-onboard --config onboard.yaml", ("log_quota_mb = 10",),
        ("onboard.yaml", "log_quota_mb: 4096", "log_quota_mb: 10"),
    ),
    Mistake(
        "metrics without a port", "clearway-onboard --config onboard.yaml",
        ("metrics.listen", "'localhost'", "HOST:PORT"),
        ("onboard.yaml", "require_preflight: false", "metrics: {listen: localhost}"),
    ),
    Mistake(
        "metrics on a port that is none", "clearway-onboard --config onboard.yaml",
        ("'127.0.0.1:94640'",),
        ("onboard.yaml", "require_preflight: false", "metrics: {listen: '127.0.0.1:94640'}"),
    ),
    Mistake(
        "a mission on board, beside a file", "clearway-onboard --config onboard.yaml",
        ("vehicle_mission", "mission: from_vehicle", "mission.yaml"),
        ("onboard.yaml", "require_preflight: false", "vehicle_mission: {altitude_m: 5.0}"),
    ),
    Mistake(
        "a mission on board below the ground", "doctor --daemon-config onboard.yaml",
        ("vehicle_mission.altitude_m [m] = -5",),
        (
            "onboard.yaml", "mission: mission.yaml",
            "mission: from_vehicle\nvehicle_mission: {altitude_m: -5.0}",
        ),
    ),
    Mistake(
        "what a mission on board cannot state", "service install --daemon-config onboard.yaml",
        ("vehicle_mission.legs", "not a known key"),
        (
            "onboard.yaml", "mission: mission.yaml",
            "mission: from_vehicle\nvehicle_mission: {legs: []}",
        ),
    ),
    Mistake(
        "a contract that is lost", "clearway-onboard --config onboard.yaml", ("mine.yaml",),
        ("onboard.yaml", "contract: contract.yaml", "contract: mine.yaml"),
    ),
    Mistake(
        "a simulated autopilot that does not exist", "clearway-sitl --config sitl.yaml",
        ("flavour = 'inav'",), ("sitl.yaml", "flavour: px4", "flavour: inav"),
    ),
    Mistake(
        "a simulated mass of nothing", "clearway-sitl --config sitl.yaml", ("mass_kg [kg] = 0",),
        ("sitl.yaml", "{radius_m: 0.40}", "{radius_m: 0.40, mass_kg: 0.0}"),
    ),
    Mistake(
        "a simulated field that is lost", "clearway-sitl --config sitl.yaml", ("wood.yaml",),
        ("sitl.yaml", "field: field.yaml", "field: wood.yaml"),
    ),
]  # fmt: skip


def changed(folder: Path, change: tuple[str, str, str]) -> None:
    name, old, new = change
    path = folder / name
    if not old:
        path.write_text(new, encoding="utf-8")
        return
    text = path.read_text(encoding="utf-8")
    assert old in text, f"{name} has no {old!r} any more"
    path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a folder once, to be copied."""
    directory = tmp_path_factory.mktemp("init")
    init(directory, "px4")
    return directory


@pytest.fixture
def _in_time() -> Iterator[None]:
    """End a process that begins to serve although it should have refused."""

    def too_late(*_: object) -> None:
        raise TimeoutError(f"not refused within {PATIENCE_S:g} s")

    before = signal.signal(signal.SIGALRM, too_late)
    signal.setitimer(signal.ITIMER_REAL, PATIENCE_S)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.usefixtures("_in_time")
@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda mistake: mistake.what)
def test_a_mistake_is_one_line_that_helps(
    clearway: Clearway,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    folder: Path,
    mistake: Mistake,
) -> None:
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)
    if mistake.change is not None:
        changed(tmp_path, mistake.change)
    monkeypatch.chdir(tmp_path)
    program, *arguments = shlex.split(mistake.command) or [""]
    processes = {"clearway-onboard": onboard_main, "clearway-sitl": sitl_main}
    if program in processes:
        code, err = processes[program](arguments), capsys.readouterr().err
    else:
        program, arguments = "clearway", [*filter(None, [program]), *arguments]
        code, _, err = clearway(*arguments)
    assert code == 2, err
    assert err.startswith(f"{program}: error: "), err
    assert err.count("\n") == 1, err
    assert len(err) < 500, err
    for word in mistake.words:
        assert word in err, err
    assert not list(tmp_path.rglob("*.mcap")), "nothing is left behind"


def test_the_table_is_long_and_covers_every_command() -> None:
    assert len(MISTAKES) >= 60
    assert [
        what for what, count in Counter(each.what for each in MISTAKES).items() if count > 1
    ] == []
    first = {shlex.split(each.command)[0] for each in MISTAKES if each.command}
    (commands,) = build_parser()._subparsers._group_actions  # type: ignore[union-attr]
    assert first >= {*(commands.choices or ()), "clearway-onboard", "clearway-sitl"}
