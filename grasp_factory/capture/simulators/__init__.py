"""Simulated devices: a stored episode played over the real transport, with faults on demand."""
