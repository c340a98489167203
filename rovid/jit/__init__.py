"""Compiled loops: SIMD vectors, tracing of branch-free functions, the cache of compiled code, warm-up."""
