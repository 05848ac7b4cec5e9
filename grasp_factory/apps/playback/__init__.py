"""Playing back a stored attempt, and writing it as a video file."""
