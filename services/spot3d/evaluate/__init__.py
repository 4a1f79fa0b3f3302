"""Metrics of the paper (Sec. VI), the truth they compare with, and how steady a run is."""
