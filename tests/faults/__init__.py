"""Faults that are seeded one at a time, to see which of them the tests catch."""
