"""Fuzz parsers with Atheris, which follows the coverage of this package's code.

    PYTHONPATH=tests python -m fuzz MODULE FOLDER [--only TARGET] [OPTION...]

MODULE is one of ``stores``, ``objects``, ``page``, ``bags``, ``sessions``. The inputs that reach
new code are kept below FOLDER, and used by the next run. Options are those of libFuzzer, such as
``-runs=1000`` or ``-max_total_time=60``; they hold for each target. It prints a line for each
target. The exit code is 1 if an input ended in an exception that is no refusal, took more than
10 s, or more than 2 GB.
"""

from __future__ import annotations

import io
import logging
import os
import re
import sys
import tempfile
import time
import warnings
from contextlib import redirect_stderr
from importlib import import_module
from pathlib import Path

import atheris
from fuzz.json_mutation import mutate_json
from fuzz.target import Target

WORDS = (
    *("0", "-1", "1e999", "NaN", "null", "true", "[]", "{}", "2147483648", "4294967296"),
    *("9223372036854775808", "\\x00", "\\x1b[2J", "../", "/", "\\xff\\xff\\xff\\xff"),
)
"""What the fuzzer inserts, escaped as libFuzzer reads it."""
LIMITS = ("-timeout=10", "-rss_limit_mb=2000", "-print_final_stats=1")


def main() -> None:
    """Fuzz the targets of a module, each in a process of its own."""
    module, folder, *options = sys.argv[1:]
    only = options.pop(options.index("--only") + 1) if "--only" in options else ""
    options = [option for option in options if option != "--only"]
    warnings.simplefilter("ignore")
    logging.disable()
    said = io.StringIO()  # a line for each module
    with redirect_stderr(said), atheris.instrument_imports(include=["grasp_factory"]):
        targets: dict[str, Target] = import_module(f"fuzz.{module}").TARGETS
    failed = False
    for name, target in targets.items():
        if only in ("", name):
            corpus = Path(folder) / f"{module} {name}".replace("/", "-").replace(" ", "-")
            failed |= not fuzz(name, target, corpus, options)
    sys.exit(failed)


def fuzz(name: str, target: Target, corpus: Path, options: list[str]) -> bool:
    """Fuzz a target in a child process; print what it did, and return whether all went well."""
    corpus.mkdir(parents=True, exist_ok=True)
    log, started = corpus.with_suffix(".log"), time.monotonic()
    with tempfile.TemporaryDirectory() as temporary:
        child = os.fork()
        if not child:
            os.environ |= {"TMPDIR": temporary, "GRASP_FACTORY_CACHE": f"{temporary}/cache"}
            tempfile.tempdir = None
            said = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(said, 1)
            os.dup2(said, 2)
            run(target, corpus, options)  # does not return
        code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    text = log.read_text(errors="replace")
    seconds = time.monotonic() - started
    facts = [_last(pattern, text) for pattern in (r"executed_units: +(\d+)", r"cov: (\d+)")]
    result = "no fault" if code == 0 else f"FAULT, see {log}"
    print(
        f"{name:32} {facts[0]:>9} runs {facts[1]:>6} edges {seconds:7.1f} s  {result}", flush=True
    )
    return code == 0


def run(target: Target, corpus: Path, options: list[str]) -> None:
    """Fuzz in this process, which then ends."""
    for i, example in enumerate(target.examples()):
        (corpus / f"example{i}").write_bytes(example)
    words = corpus.with_suffix(".words")
    words.write_text("".join(f'"{word}"\n' for word in WORDS), encoding="ascii")
    longest = 2 * max(len(example) for example in target.examples()) + 64
    atheris.Setup(
        [
            *(sys.argv[0], f"-dict={words}", f"-max_len={longest}", *LIMITS),
            *(f"-artifact_prefix={corpus}.fault-", *options, str(corpus)),
        ],
        target.run,
        custom_mutator=mutate_json if target.is_json else None,
    )
    atheris.Fuzz()


def _last(pattern: str, text: str) -> str:
    return (re.findall(pattern, text) or ["-"])[-1]


if __name__ == "__main__":
    main()
