"""Real rclpy as a peer of our topics: see ``run.py``."""
