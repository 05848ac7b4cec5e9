"""What a fuzzer runs: a parser of ours, and examples to start from."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from grasp_factory.errors import GraspFactoryError


@dataclass(frozen=True)
class Target:
    """A parser of something that a stranger may have made.

    Attributes:
        parse: gets any bytes. It may refuse them with one of ``refusals``; another exception is a
            fault.
        examples: returns valid inputs.
        refusals: exceptions that are an answer.
        is_json: whether most inputs shall be JSON.
    """

    parse: Callable[[bytes], object]
    examples: Callable[[], list[bytes]]
    refusals: tuple[type[Exception], ...] = (GraspFactoryError,)
    is_json: bool = False

    def run(self, data: bytes) -> None:
        """Parse an input.

        Raises:
            Exception: if the parser fails in another way than by a refusal.
        """
        try:
            self.parse(data)
        except self.refusals:
            pass
