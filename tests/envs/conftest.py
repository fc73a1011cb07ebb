"""What the tests of environments share: walks of one task are written down once."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _once(each_gait_is_written_once: None) -> None:
    """Also here."""
