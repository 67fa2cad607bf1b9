"""The wire: the one room that reads and writes the fields of ROS messages. Needs no rclpy."""
