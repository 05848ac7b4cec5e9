"""ROS 2 without a ROS installation: publish and collect topics with Cyclone DDS."""
