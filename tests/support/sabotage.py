"""A ``sitecustomize`` that makes the episodes of worker processes fail."""

from __future__ import annotations

SABOTAGE = """
import os, signal, sys, time
from pathlib import Path

if "--multiprocessing-fork" in sys.argv:  # in workers only
    import grasp_factory.factory.block_maker as blocks

    real = blocks.run_episode

    def run_episode(world, spec):
        {deeds}
        return real(world, spec)

    blocks.run_episode = run_episode
"""
