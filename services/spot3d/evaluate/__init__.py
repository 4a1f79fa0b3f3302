"""Metrics of the paper (Sec. VI), the ground truth they need, and the stability of a run."""
