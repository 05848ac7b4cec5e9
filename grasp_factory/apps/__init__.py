"""Tools that stand on the rest, one folder each."""
