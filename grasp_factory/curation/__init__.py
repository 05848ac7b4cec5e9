"""Checking and changing stores: verify, repair, merge, split, relabel, replay."""
