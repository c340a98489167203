"""Plots and one page that hold the whole result."""

from rovid.ground.caches import keep_fonts

keep_fonts()  # before any module of this package imports matplotlib
