"""ROS bags: the messages of an episode, and the files of ROS 1 and ROS 2 that hold them."""
