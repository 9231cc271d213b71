"""Mutations: reproducible, of many kinds, and some that keep the form of a text."""

import numpy as np

from tools.fuzz.mutation import mutate

TABLE = b"a,b\n1.5,2\n3,4e-2\n"


def test_equal_seeds_give_equal_bytes_and_most_seeds_change_them() -> None:
    first, again = ([mutate(TABLE, np.random.default_rng(seed)) for seed in range(200)] for _ in range(2))
    assert first == again
    assert len(set(first)) > 100 and sum(content != TABLE for content in first) > 180


def test_half_of_the_text_keeps_its_form() -> None:
    contents = [mutate(TABLE, np.random.default_rng(seed)) for seed in range(300)]
    with_form = sum(content.startswith(b"a,b\n") and content.count(b",") == 3 for content in contents)
    assert 90 < with_form < 250


def test_empty_and_binary_content_is_mutated() -> None:
    contents = [mutate(bytes(range(256)), np.random.default_rng(seed)) for seed in range(300)]
    assert any(b"\xff\xff\xff\x7f" in content for content in contents)
    assert all(isinstance(mutate(b"", np.random.default_rng(seed)), bytes) for seed in range(50))
