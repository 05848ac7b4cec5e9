"""Import of ROS bags: what is in a bag, and its images and series as files."""
