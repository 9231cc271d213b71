"""Cache of a study: an entry is made once, also by processes at the same time, and whole or not at all."""

import multiprocessing
from pathlib import Path

import pytest

from asfm.study.feature_cache import StudyCache
from tests.study.cache_worker import provide_slowly


def test_an_entry_is_made_once(tmp_path: Path) -> None:
    cache, made = StudyCache(tmp_path), []

    def make(folder: Path) -> None:
        made.append(folder)
        (folder / "value").write_text("1")

    first = cache.provide("kind", "key", make)
    assert cache.provide("kind", "key", make) == first == tmp_path / "kind" / "key"
    assert (first / "value").read_text() == "1" and len(made) == 1
    cache.provide("kind", "other", make)
    assert len(made) == 2


def test_what_fails_leaves_no_entry(tmp_path: Path) -> None:
    def fail(folder: Path) -> None:
        (folder / "half").write_text("1")
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        StudyCache(tmp_path).provide("kind", "key", fail)
    assert [path.name for path in (tmp_path / "kind").iterdir()] == ["key.lock"]


def test_processes_at_the_same_time_make_an_entry_once(tmp_path: Path) -> None:
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=provide_slowly, args=(tmp_path, str(number))) for number in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0, 0, 0]
    assert len(list((tmp_path / "made").iterdir())) == 1
