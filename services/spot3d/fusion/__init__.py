"""Multi-view fusion of heat into a 3D heatmap, and the objects in it (paper, Sec. V)."""
