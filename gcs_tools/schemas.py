"""``clearway schema``: writes JSON Schemas, with which editors complete and check the files."""

from __future__ import annotations

import json
from pathlib import Path
from types import MappingProxyType

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema

from gcs_tools.console.errors import CommandError
from gcs_tools.preflight.live.bus import BusConfig
from gcs_tools.scenario import ScenarioFile
from onboard.files.contract_file import Contract
from onboard.files.daemon_config import DaemonConfig
from onboard.files.geofence_file import Geofence
from onboard.files.mission_file import Mission
from onboard.files.obstacle_field import ObstacleList
from onboard.fleet.fleet_file import Fleet
from sitl.config import SitlConfig

MODELS: MappingProxyType[str, type[BaseModel]] = MappingProxyType(
    {
        "contract": Contract,
        "mission": Mission,
        "geofence": Geofence,
        "fleet": Fleet,
        "field": ObstacleList,
        "scenario": ScenarioFile,
        "onboard": DaemonConfig,
        "sitl": SitlConfig,
        "bus": BusConfig,
    }
)


def schema_text(model: type[BaseModel]) -> str:
    """Return a model's JSON Schema as the text of a file."""
    document = {"$schema": GenerateJsonSchema.schema_dialect, **model.model_json_schema()}
    return json.dumps(document, indent=2, ensure_ascii=False) + "\n"


def write_schemas(directory: Path) -> None:
    """Write ``<name>.schema.json`` for every kind of file.

    Raises:
        CommandError: the directory cannot be written.
    """
    try:
        directory.mkdir(parents=True, exist_ok=True)
        for name, model in MODELS.items():
            path = directory / f"{name}.schema.json"
            path.write_text(schema_text(model), encoding="utf-8")
    except OSError as error:
        raise CommandError(f"{directory}: cannot be written: {error.strerror or error}") from error
