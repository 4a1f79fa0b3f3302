"""Objects of single keyframes (paper, Sec. V-A), the segments that fusion lets vote."""
