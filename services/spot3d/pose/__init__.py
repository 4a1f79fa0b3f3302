"""Pose: where the camera is at each frame."""
