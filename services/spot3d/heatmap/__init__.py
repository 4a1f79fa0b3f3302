"""Soft and hard depth filtering of 2D proposals and the weighted 2D heatmap (paper, Sec. IV)."""
