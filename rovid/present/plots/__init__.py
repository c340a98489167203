"""Figures of the page, one file each."""

from rovid.jit.cache_dirs import keep_fonts

keep_fonts()  # before any module of this package imports matplotlib
