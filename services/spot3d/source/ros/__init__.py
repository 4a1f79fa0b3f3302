"""ROS recordings: bags of version 1 and 2 as sequences of frames."""
