"""Fixtures of the readers' tests."""

from __future__ import annotations

from tests.readers.conftest import config

__all__ = ["config"]
