"""ROS plumbing that the nodes and the command line share: the only room that imports rclpy."""
