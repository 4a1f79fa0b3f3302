"""Objects of single keyframes (paper, Sec. VI-A), the segments that fusion lets vote."""
