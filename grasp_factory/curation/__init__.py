"""Check and change stores: verify, repair, merge, split, relabel, replay."""
