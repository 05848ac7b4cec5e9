"""Measure the quality of a session, and score it from 1 to 5."""
