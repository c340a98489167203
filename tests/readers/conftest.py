"""A campaign folder for the readers' tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from rovid.trial.config import Config
from tests.readers.logs import campaign


@pytest.fixture
def config(tmp_path: Path) -> Config:
    return campaign(tmp_path)
