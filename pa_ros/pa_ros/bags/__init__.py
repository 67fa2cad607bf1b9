"""Bags: writing, reading, repairing and learning from rosbag2 recordings. Needs no rclpy."""
