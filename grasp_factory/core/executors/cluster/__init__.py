"""Executors of several nodes: an agent on each, and a coordinator in the process of the run."""
