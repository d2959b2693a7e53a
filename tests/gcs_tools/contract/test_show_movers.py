"""What `clearway contract show` says of movers."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from gcs_tools.contract.show import print_movers
from onboard.contract.assessment import assess
from onboard.files.contract_file import Contract
from onboard.files.yaml_file import read_mapping, validate

AVOID = Path("config/avoid_contract.yaml")


@pytest.mark.parametrize(("level", "waited"), [("none", False), ("passive", True)])
def test_where_nothing_is_enforced_none_is_waited_for(level: str, waited: bool) -> None:
    document = read_mapping(AVOID)
    document["requirements"]["movers"] = level
    written = io.StringIO()
    contract = validate(document, Contract, source="here")
    print_movers(assess(contract), Console(file=written, width=200))
    assert "person 0.4 m/s: passive" in written.getvalue()
    assert ("waited for" in written.getvalue()) == waited
