"""Fingerprints: equal for equal contents, different for any change."""

from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.study.fingerprint import hash_content, hash_function, hash_path


def test_the_order_of_keys_does_not_matter() -> None:
    assert hash_content({"a": 1, "b": [1, 2]}) == hash_content({"b": [1, 2], "a": 1})
    assert hash_content({"a": 1, "b": [1, 2]}) != hash_content({"a": 1, "b": [2, 1]})


def test_contents_and_names_of_files_matter_and_their_place_does_not(tmp_path: Path) -> None:
    for name in ("one", "two", "renamed", "longer"):
        (tmp_path / name / "sub").mkdir(parents=True)
        (tmp_path / name / "a.txt").write_text("text")
    (tmp_path / "renamed" / "a.txt").rename(tmp_path / "renamed" / "b.txt")
    (tmp_path / "longer" / "sub" / "c.txt").write_text("")
    assert hash_path(tmp_path / "one") == hash_path(tmp_path / "two")
    assert len({hash_path(tmp_path / name) for name in ("one", "renamed", "longer")}) == 3
    assert hash_path(tmp_path / "one" / "a.txt") == hash_path(tmp_path / "two" / "a.txt")


def test_a_function_is_found_without_being_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    module = tmp_path / "explosive_matcher.py"
    module.write_text("raise RuntimeError\n")
    before = hash_function("explosive_matcher:match")
    module.write_text("raise RuntimeError  # changed\n")
    assert hash_function("explosive_matcher:match") != before
    with pytest.raises(AsfmError, match="'nowhere:match': expected a module on Python's path, found none"):
        hash_function("nowhere:match")
