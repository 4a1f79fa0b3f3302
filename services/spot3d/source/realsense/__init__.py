"""RealSense cameras and their recordings, through librealsense's own pyrealsense2."""
