"""Metrics of the paper (Sec. V), the truth they compare with, and how steady a run is."""
