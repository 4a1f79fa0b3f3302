"""The 3D heatmap: its points, the registration of frames with it, and which of its points count."""
