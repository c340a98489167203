"""Compiled loops: a four-lane vector, two backends that compile it, and a cache of compiled code; see docs/jit.md."""
