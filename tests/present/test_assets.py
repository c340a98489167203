"""What a page carries inside itself."""

from __future__ import annotations

from rovid.present.page.assets import read_assets


def test_the_library_comes_with_its_licence_and_fits_into_a_page() -> None:
    assets = read_assets()
    assert "The MIT License (MIT)" in assets.script
    assert "uPlot (v1.6.32)" in assets.script
    assert "</script" not in assets.script.lower()
    assert "<!--" not in assets.script
    assert "url(" not in assets.style
    assert "@import" not in assets.style
