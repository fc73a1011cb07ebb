"""What the tests of pictures share: plans are timed once, walks of one task are written once."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def _once(each_plan_is_timed_once: None, each_gait_is_written_once: None) -> None:
    """Also here."""
