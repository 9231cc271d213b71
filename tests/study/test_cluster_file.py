"""Cluster file: faults that are named, and jobs that go through a queueing system's own commands."""

import os
import sys
from pathlib import Path

import pytest

from asfm.errors import AsfmError
from asfm.study.cluster_file import ClusterSettings, read_cluster, start_cluster
from asfm.study.dask_client import open_client
from tests.study.conftest import ROOT

pytest.importorskip("dask_jobqueue", reason="the extra cluster is not installed")

SLURM = "class: SLURMCluster\njobs: 1\narguments: {cores: 2, memory: 2GB, queue: batch, walltime: '00:05:00'"
FAULTS = {
    "": "expected the keys class, jobs and arguments, found None",
    "jobs: 2": "key 'class' of the cluster: Field required",
    "class: local\nworkers: 3": "unknown key 'workers'; known here: arguments, class, jobs",
    "class: local\njobs: 0": "key 'jobs' of the cluster: Input should be greater than or equal to 1, found 0",
    "class: local\narguments: [1]": "key 'arguments' of the cluster: Input should be a valid dictionary",
    "class: local\narguments: {preload: x}": "unknown argument 'preload' of local; known here: local_directory, memory",
    "class: os.system": "expected as class one of local, HTCondorCluster, .*SLURMCluster, found 'os.system'",
    "class: JobQueueCluster": "expected as class one of local, .*, found 'JobQueueCluster'",
    SLURM + ", speed: 9}": "unknown argument 'speed' of SLURMCluster; known here: account, .*cores, .*walltime",
    SLURM + ", job_cls: x}": "unknown argument 'job_cls' of SLURMCluster",
    "class: local\narguments: {n_workers: !!python/name:os.system x}": "expected plain values, found the tag",
}
SUBMIT = """#!/bin/sh
cp "$1" "{folder}/job.sh"
setsid sh "{folder}/job.sh" > "{folder}/job.log" 2>&1 &
echo "Submitted batch job $!"
"""
CANCEL = """#!/bin/sh
echo "$1" > "{folder}/cancelled"
kill -- -"$1"
"""


@pytest.mark.parametrize("content", FAULTS)
def test_faults_of_the_file_are_named(content: str, tmp_path: Path) -> None:
    path = tmp_path / "cluster.yaml"
    path.write_text(content)
    with pytest.raises(AsfmError, match=f"{path}: .*{FAULTS[content]}"):
        read_cluster(path)


def read(folder: Path, content: str) -> tuple[Path, ClusterSettings]:
    path = folder / "cluster.yaml"
    path.write_text(content)
    return path, read_cluster(path)


def test_a_queueing_system_that_is_not_here_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with (
        pytest.raises(AsfmError, match="submits jobs by sbatch, which this machine"),
        start_cluster(*read(tmp_path, SLURM + "}")),
    ):
        pass


@pytest.mark.parametrize("arguments", ["{cores: 2}", "{cores: many, memory: 1GB}", "{cores: 1, memory: lots}"])
def test_values_that_dask_jobqueue_refuses_are_one_line(
    arguments: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_program(tmp_path / "sbatch", SUBMIT, tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    settings = read(tmp_path, f"class: SLURMCluster\narguments: {arguments}")
    with pytest.raises(AsfmError, match=r"cluster.yaml: cannot start SLURMCluster: "), start_cluster(*settings):
        pass


def test_a_job_that_the_queueing_system_refuses_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_program(tmp_path / "sbatch", "#!/bin/sh\necho invalid partition 7 >&2\nexit 1\n", tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    settings = read(tmp_path, SLURM + ", interface: lo}")
    with pytest.raises(AsfmError, match=r"cannot start SLURMCluster: .*invalid partition 7"), start_cluster(*settings):
        pass


def write_program(path: Path, text: str, folder: Path) -> None:
    path.write_text(text.format(folder=folder))
    path.chmod(0o755)


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-ins for sbatch and scancel are shell scripts")
def test_jobs_are_submitted_and_cancelled_by_the_queueing_system(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_program(tmp_path / "sbatch", SUBMIT, tmp_path)
    write_program(tmp_path / "scancel", CANCEL, tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    content = SLURM + f", interface: lo, local_directory: {tmp_path / 'scratch'}" + "}"
    with start_cluster(*read(tmp_path, content)) as cluster, open_client(cluster) as client:
        client.wait_for_workers(2, timeout=60)
        assert sorted(client.nthreads().values()) == [1, 1], "a process a core, of one thread each"
        assert client.submit(os.getenv, "PYTHONPATH").result() == str(ROOT)
    script = (tmp_path / "job.sh").read_text()
    assert "#SBATCH -p batch" in script and "#SBATCH -t 00:05:00" in script
    assert (tmp_path / "cancelled").read_text().strip().isdigit(), "the job is cancelled at the end"
