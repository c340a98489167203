"""Figures of the page, one file each."""

from rovid.jit.cache_dirs import configure_font_cache

configure_font_cache()  # before any module of this package imports matplotlib
