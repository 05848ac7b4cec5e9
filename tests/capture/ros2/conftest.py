"""A network of its own for topics, and commands that run in it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.network_namespace import Namespace, NoNamespaceError, network_namespace
from support.topic_commands import TopicCommands


@pytest.fixture(scope="session")
def namespace() -> Iterator[Namespace]:
    """Return a network namespace, or skip the test if the machine allows none."""
    try:
        with network_namespace() as found:
            yield found
    except NoNamespaceError as error:
        pytest.skip(f"this machine allows no network namespace: {error}")


@pytest.fixture
def topics(namespace: Namespace) -> Iterator[TopicCommands]:
    """Return what runs commands of topics; those that still run at the end are killed."""
    commands = TopicCommands(namespace)
    yield commands
    commands.kill()
