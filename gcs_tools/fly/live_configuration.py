"""The files of a live flight's two processes, and where they meet."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from gcs_tools.console.errors import CommandError
from gcs_tools.scenario import Scenario, obstacle_list
from onboard.files.daemon_config import DaemonConfig, MavlinkLink, SigningConfig
from onboard.files.yaml_file import dump_document
from onboard.files.zenoh_endpoints import ZenohEndpoints
from onboard.mavlink.profiles.registry import profile_named
from sitl.config import SitlConfig

VEHICLE_NAME = "vehicle"
_KEY_FILE = Path("mavlink.key")
# Telemetry older than this is ignored: a loaded computer delays its processes.
TELEMETRY_TIMEOUT_S = 0.5


@dataclass(frozen=True)
class Endpoints:
    """Ports of the three parts on this computer."""

    daemon_mavlink_port: int
    operator_mavlink_port: int
    sitl_zenoh_port: int
    daemon_zenoh_port: int

    @property
    def operator_url(self) -> str:
        """MAVSDK connection URL of the operator."""
        return f"udpin://127.0.0.1:{self.operator_mavlink_port}"

    @property
    def sitl_zenoh(self) -> str:
        """Zenoh endpoint on which the simulation listens."""
        return f"tcp/127.0.0.1:{self.sitl_zenoh_port}"

    @property
    def daemon_zenoh(self) -> str:
        """Zenoh endpoint on which the daemon listens."""
        return f"tcp/127.0.0.1:{self.daemon_zenoh_port}"


def write_configuration(
    scenario: Scenario,
    endpoints: Endpoints,
    *,
    seed: int,
    out: Path,
    fly_outside_contract: bool,
    mavlink_key: bytes | None = None,
) -> None:
    """Write the configuration of both processes; it refers to nothing outside the directory.

    Raises:
        CommandError: a file cannot be written.
    """
    models: dict[str, BaseModel] = {
        "contract": scenario.contract,
        "mission": scenario.mission,
        "onboard": _onboard_configuration(
            scenario,
            endpoints,
            fly_outside_contract=fly_outside_contract,
            signs=mavlink_key is not None,
        ),
        "sitl": _sitl_configuration(scenario, endpoints, seed, signs=mavlink_key is not None),
    }
    documents: dict[str, Any] = {
        name: model.model_dump(mode="json") for name, model in models.items()
    }
    documents["field"] = [
        obstacle.model_dump(mode="json") for obstacle in obstacle_list(scenario.obstacles)
    ]
    try:
        for name, document in documents.items():
            text = dump_document(document)
            (out / f"{name}.yaml").write_text(text, encoding="utf-8")
        if mavlink_key is not None:
            _write_key(out / _KEY_FILE, mavlink_key)
    except OSError as error:
        raise CommandError(f"{out}: cannot be written: {error.strerror or error}") from error


def _write_key(path: Path, key: bytes) -> None:
    """Write a key so that only its owner can read it."""
    path.unlink(missing_ok=True)
    path.touch(mode=0o600)
    path.write_text(f"{key.hex()}\n", encoding="ascii")


def _onboard_configuration(
    scenario: Scenario, endpoints: Endpoints, *, fly_outside_contract: bool, signs: bool
) -> DaemonConfig:
    return DaemonConfig(
        vehicle=VEHICLE_NAME,
        contract=Path("contract.yaml"),
        mission=Path("mission.yaml"),
        mavlink=MavlinkLink(
            url=f"udpin://127.0.0.1:{endpoints.daemon_mavlink_port}",
            system_id=scenario.plant.system_id,
            telemetry_timeout_s=TELEMETRY_TIMEOUT_S,
            signing=SigningConfig(key_file=_KEY_FILE, link_id=1) if signs else None,
        ),
        zenoh=ZenohEndpoints(connect=(endpoints.sitl_zenoh,), listen=(endpoints.daemon_zenoh,)),
        sources=scenario.sources,
        log_directory=Path(),
        log_file=Path("flight.mcap"),
        fly_outside_contract=fly_outside_contract,
        require_preflight=not fly_outside_contract,
    )


def _sitl_configuration(
    scenario: Scenario, endpoints: Endpoints, seed: int, *, signs: bool
) -> SitlConfig:
    has_key = scenario.plant.signing_passphrase or scenario.plant.signing_key_hex
    sitl = scenario.sitl_config(
        vehicle=VEHICLE_NAME,
        mavlink=(
            f"udpout://127.0.0.1:{endpoints.daemon_mavlink_port}",
            f"udpout://127.0.0.1:{endpoints.operator_mavlink_port}",
        ),
        zenoh={"listen": (endpoints.sitl_zenoh,), "connect": ()},
        field="field.yaml",
        signing_key_file=str(_KEY_FILE) if signs and not has_key else None,
        seed=seed,
        truth_log="truth.mcap",
    )
    parameters = profile_named(sitl.flavour).parameters
    # This flight has no radio, so its loss triggers nothing.
    no_radio = {} if parameters is None else dict([parameters.no_radio])
    return sitl.model_copy(update={"parameters": no_radio | sitl.parameters})
