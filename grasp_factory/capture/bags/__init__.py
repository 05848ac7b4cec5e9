"""Bags of ROS 1 and ROS 2 from anybody: opened, their messages read, their images decoded."""
