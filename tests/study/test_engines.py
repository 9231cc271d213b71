"""Choice of the engine: one of three, and faults before any work."""

from importlib.util import find_spec
from pathlib import Path

import pytest

from asfm.cli import run_command_line
from asfm.errors import AsfmError
from asfm.study.engines import choose_engine

STUDY = Path(__file__).resolve().parents[2] / "tools" / "matcher_study_quick.yaml"


@pytest.mark.parametrize(
    ("options", "found"),
    [
        (("--scheduler", "tcp://h:1", "--cluster", "c.yaml"), "--scheduler and --cluster"),
        (("--jobs", "2", "--scheduler", "tcp://h:1"), "--jobs and --scheduler"),
        (("--jobs", "2", "--cluster", "c.yaml"), "--jobs and --cluster"),
    ],
)
def test_one_engine_is_chosen(
    tmp_path: Path, options: tuple[str, ...], found: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run_command_line(["study", str(STUDY), "--output", str(tmp_path / "out"), *options]) == 2
    message = capsys.readouterr().err
    assert message == f"asfm: expected one of --jobs, --scheduler and --cluster, found {found}\n"
    assert not (tmp_path / "out").exists()


def test_no_process_is_too_few() -> None:
    with pytest.raises(AsfmError, match="expected at least one process"):
        choose_engine(jobs=0)


def test_the_extra_is_asked_for_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    def hide(name: str, package: str | None = None) -> object:
        return None if name == "distributed" else find_spec(name, package)

    monkeypatch.setattr("asfm.study.dask_client.find_spec", hide)
    message = r"need distributed: install asfm .* pip install 'asfm\[cluster\]'"
    with pytest.raises(AsfmError, match=message):
        choose_engine(scheduler="tcp://h:1")
    with pytest.raises(AsfmError, match=message):
        choose_engine(cluster=Path("c.yaml"))
