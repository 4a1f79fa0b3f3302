"""Benchmarks, and the plain NumPy transcriptions of the paper's steps that they and the tests compare with."""
