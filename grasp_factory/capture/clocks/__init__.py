"""Device time to host time: cut at jumps and wraps, fitted by the samples that came fastest."""
