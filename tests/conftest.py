"""What all tests share."""

from __future__ import annotations

import pytest
from manual.records import Recorder


@pytest.fixture
def verification(request: pytest.FixtureRequest) -> Recorder:
    """Takes the numbers of a comparison for the verification manual."""
    return Recorder(request.node.nodeid)
