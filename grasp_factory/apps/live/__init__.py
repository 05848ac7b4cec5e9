"""The live view: what a run does, shown while it runs, with alarms.

``state`` remembers what happened, ``alarms`` says what is wrong with it; both are pure. ``facts``
reads what is committed, ``watch`` does all this in a thread of its own, ``view`` serves it.
"""

from __future__ import annotations

from grasp_factory.apps.live.alarms import findings
from grasp_factory.apps.live.drift import SuccessDrift
from grasp_factory.apps.live.facts import BlockFacts, Disk, EpisodeFacts
from grasp_factory.apps.live.state import Asked, LiveState
from grasp_factory.apps.live.view import LiveView
from grasp_factory.core.alarm_book import Alarm, AlarmBook, Finding

__all__ = [
    "Alarm",
    "AlarmBook",
    "Asked",
    "BlockFacts",
    "Disk",
    "EpisodeFacts",
    "Finding",
    "LiveState",
    "LiveView",
    "SuccessDrift",
    "findings",
]
