"""A dataset's card: what is in it and what it is good for, for people and for machines."""

from __future__ import annotations

from grasp_factory.apps.card.making import FILES, Card, write_card
from grasp_factory.apps.card.publication import Publication

__all__ = ["FILES", "Card", "Publication", "write_card"]
