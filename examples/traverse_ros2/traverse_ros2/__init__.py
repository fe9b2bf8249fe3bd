"""A measuring arm as a node of ROS 2."""
