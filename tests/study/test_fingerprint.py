"""Fingerprints: equal for equal contents, different for any change."""

from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.study.fingerprint import hash_content, hash_function, hash_path, hash_software, hash_sources


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


def test_every_file_of_a_function_s_package_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file that defines the function may be another one than the module that names it."""
    monkeypatch.syspath_prepend(str(tmp_path))
    package = tmp_path / "pack_of_matchers"
    (package / "deep").mkdir(parents=True)
    for name in ("__init__.py", "deep/__init__.py", "deep/matcher.py", "impl.py"):
        (package / name).write_text("# first\n")
    seen = {hash_function("pack_of_matchers.deep.matcher:match")}
    for name in ("impl.py", "deep/matcher.py"):
        (package / name).write_text("# second\n")
        seen.add(hash_function("pack_of_matchers.deep.matcher:match"))
    (package / "notes.txt").write_text("no source")
    seen.add(hash_function("pack_of_matchers.deep.matcher:match"))
    assert len(seen) == 3


def test_sources_of_left_out_folders_do_not_count(tmp_path: Path) -> None:
    (tmp_path / "study" / "report").mkdir(parents=True)
    (tmp_path / "a.py").write_text("")
    before = hash_sources(tmp_path, ("study/report",))
    (tmp_path / "study" / "report" / "b.py").write_text("")
    assert hash_sources(tmp_path, ("study/report",)) == before != hash_sources(tmp_path)


def test_another_release_of_a_library_is_other_software(monkeypatch: pytest.MonkeyPatch) -> None:
    own = hash_software()
    hash_software.cache_clear()
    monkeypatch.setattr("asfm.study.fingerprint.find_version", lambda _: "0.0")
    other = hash_software()
    hash_software.cache_clear()
    assert own != other
