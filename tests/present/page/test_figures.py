"""The pictures of a page."""

from __future__ import annotations

import pytest

from rovid.present.page import figures


@pytest.mark.parametrize(("count", "suffixes"), [(1, [""]), (6, [""]), (13, ["_01", "_02", "_03"])])
def test_sheets_hold_all_items(count: int, suffixes: list[str]) -> None:
    sheets = list(figures.paginate(range(count), 6))
    assert [suffix for _, suffix in sheets] == suffixes
    assert [item for part, _ in sheets for item in part] == list(range(count))
