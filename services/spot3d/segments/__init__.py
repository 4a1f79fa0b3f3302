"""Segments: the objects of single keyframes (paper, Sec. VI-A), which vote in fusion."""
