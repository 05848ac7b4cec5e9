"""A fingerprint: the same wherever bytes are the same, another one where they are not."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.platform_processes import WITHOUT_FMA, in_a_process, needs_fma

from grasp_factory.core.config.factory_config import FactoryConfig
from grasp_factory.core.machine import UNKNOWN, level, platform_facts
from grasp_factory.core.platforms import (
    FINGERPRINT,
    PARTS,
    Fingerprint,
    differing,
    fingerprint_of,
    is_fingerprint,
    meaning,
    parsed,
)
from grasp_factory.errors import StoreError
from grasp_factory.simulation import fingerprint as measuring
from grasp_factory.simulation.fingerprint import fingerprint

SOME = Fingerprint(engine="00000001", images="0000000a", libm="deadbeef", arithmetic="12345678")
WITH_A_MODEL = replace(SOME, network="99999999")
MEASURED = (
    "from grasp_factory import FactoryConfig;"
    "from grasp_factory.simulation.fingerprint import fingerprint;"
    "print(fingerprint(FactoryConfig()).text)"
)


class TestMeasuring:
    @pytest.mark.slow
    @pytest.mark.parametrize(
        "variables",
        [
            {},
            {"OPENBLAS_CORETYPE": "Haswell"},
            {"OPENBLAS_CORETYPE": "Nehalem"},
            {"NPY_DISABLE_CPU_FEATURES": "X86_V4 AVX512_ICL"},
        ],
        ids=str,
    )
    def test_it_is_the_same_in_every_process_whatever_kernels_numpy_has(
        self, variables: dict[str, str]
    ) -> None:
        there = in_a_process(MEASURED, variables)
        assert there == fingerprint(FactoryConfig()).text

    @needs_fma
    def test_another_libm_is_told_from_this_one_by_what_the_engine_makes_of_it(self) -> None:
        there = Fingerprint.parse(in_a_process(MEASURED, WITHOUT_FMA))
        assert {"engine", "libm"} <= set(differing(there, fingerprint(FactoryConfig())))

    def test_measuring_again_in_one_process_gives_the_same(self) -> None:
        first = fingerprint(FactoryConfig())
        measuring._measured.cache_clear()
        again = fingerprint(FactoryConfig())
        assert again is not first
        assert again == first

    @pytest.mark.parametrize(
        ("name", "part"),
        [("_tumble", "engine"), ("_libm", "libm"), ("_transforms", "arithmetic")],
    )
    def test_a_last_bit_of_what_a_part_is_made_from_changes_that_part_alone(
        self, name: str, part: str, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        import numpy as np

        real = getattr(measuring, name)

        def off(*args: object) -> list[object]:
            values = list(real(*args))
            values[-1] = np.nextafter(values[-1], 9.0)
            return values

        before = fingerprint(FactoryConfig())
        monkeypatch.setattr(measuring, name, off)
        measuring._measured.cache_clear()
        try:
            assert differing(before, fingerprint(FactoryConfig())) == (part,)
        finally:
            measuring._measured.cache_clear()


class TestText:
    @pytest.mark.parametrize("known", [SOME, WITH_A_MODEL])
    def test_a_text_is_one_line_and_gives_the_fingerprint_back(self, known: Fingerprint) -> None:
        assert known.text.isprintable()
        assert str(known) in known.text
        assert Fingerprint.parse(known.text) == known
        assert fingerprint_of({FINGERPRINT: known.parts()}) == known

    def test_each_letter_of_a_text_counts(self) -> None:
        for i, letter in enumerate(WITH_A_MODEL.text):
            other = "1" if letter == "0" else "0"
            damaged = WITH_A_MODEL.text[:i] + other + WITH_A_MODEL.text[i + 1 :]
            assert not is_fingerprint(damaged), damaged
            assert not is_fingerprint(WITH_A_MODEL.text[:i])

    @pytest.mark.parametrize(
        "text",
        [
            "",
            " check:00000000",
            SOME.text + "\n",
            SOME.text + " ",
            " " + SOME.text,
            str(SOME),
            SOME.text.upper(),
            SOME.text + " " + SOME.text,
            "engine:00000001 " * 10_000,
            "\udcff engine:\u0663",
        ],
    )
    def test_what_is_no_text_of_ours_is_refused_by_name(self, text: str) -> None:
        with pytest.raises(StoreError, match="is no fingerprint, or is damaged"):
            Fingerprint.parse(text)

    @given(st.text(max_size=80))
    def test_no_words_at_all_make_it_fail_otherwise(self, text: str) -> None:
        assert parsed(text) is None

    @pytest.mark.parametrize(
        "parts",
        [
            None,
            [],
            "engine",
            {},
            {"engine": "00000001"},
            {**SOME.parts(), "more": "00000001"},
            {**SOME.parts(), "libm": "0000000G"},
            {**SOME.parts(), "libm": "0000000\u0663"},
            {**SOME.parts(), "libm": 1},
            {**SOME.parts(), "libm": ""},
            {**SOME.parts(), "network": ["a"]},
        ],
    )
    def test_what_is_no_attribute_of_ours_is_no_fingerprint(self, parts: object) -> None:
        with pytest.raises(StoreError):
            Fingerprint.from_parts(parts)
        assert fingerprint_of({FINGERPRINT: parts}) is None

    def test_parts_that_differ_are_named_with_what_they_mean(self) -> None:
        other = replace(SOME, engine="00000002", libm="deadbee0")
        assert differing(SOME, SOME) == ()
        assert differing(SOME, other) == ("engine", "libm")
        assert differing(SOME, WITH_A_MODEL) == ("network",)
        said = "engine (simulation steps) and libm (the C library's sine and its kind)"
        assert meaning(differing(SOME, other)) == said
        assert meaning(["images"]) == "images (rendered images)"

    def test_every_part_has_a_meaning(self) -> None:
        assert WITH_A_MODEL.parts().keys() == PARTS.keys()


class TestFacts:
    def test_the_facts_are_short_words(self) -> None:
        facts = platform_facts()
        assert list(facts) == ["machine", "libc", "cpu", "level", "kernels"]
        assert all(isinstance(fact, str) and len(fact) < 100 for fact in facts.values())

    @pytest.mark.parametrize(
        ("flags", "want"),
        [
            ("", UNKNOWN),
            ("fp asimd evtstrm", UNKNOWN),
            ("cmov cx8 fpu fxsr mmx sse sse2", "x86-64-v1"),
            ("cmov cx8 fpu fxsr mmx sse sse2 avx2 fma", "x86-64-v1"),
            (
                "cmov cx8 fpu fxsr mmx sse sse2 cx16 lahf_lm pni popcnt sse4_1 sse4_2 ssse3",
                "x86-64-v2",
            ),
        ],
    )
    def test_the_level_is_the_highest_of_which_nothing_is_missing(
        self, flags: str, want: str
    ) -> None:
        assert level(flags) == want
