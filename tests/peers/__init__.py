"""Readers of other projects, each in a folder: see ``run.py``."""
