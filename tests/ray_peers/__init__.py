"""Checks with a real Ray cluster on loopback: bin/check-ray and bin/ray-demo."""
