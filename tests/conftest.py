"""Fixtures that many test files share."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

settings.register_profile("same examples", derandomize=True)
settings.register_profile("new examples")
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same examples"))
"""Examples are the same in every run; HYPOTHESIS_PROFILE="new examples" draws others."""

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of public recordings beside the checkout; tests that need it skip where it is absent."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"the public recordings are not at {SHARED_DATA}")
    return SHARED_DATA
