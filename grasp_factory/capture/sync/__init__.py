"""Samples of several devices that belong together, with the spread of every pair."""
