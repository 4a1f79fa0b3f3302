"""Benchmarks, and plain NumPy transcriptions of the paper's steps, with which they and the tests compare."""
