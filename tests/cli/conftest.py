"""Fixtures of the tests of the command line."""

from pathlib import Path

import pytest

from asfm.commands import SimulationOptions, simulate_to


@pytest.fixture(scope="session")
def sequence_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a simulated sequence of three frames."""
    folder = tmp_path_factory.mktemp("sequence") / "tank"
    simulate_to("tank", folder, SimulationOptions(sonar="holoocean", frames=3))
    return folder
