"""Entry point: version, help, exit codes and pipes."""

import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from asfm import __version__
from asfm.cli import main, run_command_line

COMMANDS = ("run", "info", "evaluate", "view", "simulate", "denoise", "convert", "demo")
HEAVY_MODULES = ("numpy", "yaml", "rich", "asfm.commands")


@pytest.mark.parametrize(("argument", "answer"), [("--version", f"asfm {__version__}\n"), ("--help", "Usage: asfm")])
def test_version_and_help_load_no_heavy_module(argument: str, answer: str) -> None:
    code = "import sys; from asfm.cli import run_command_line; code = run_command_line(sys.argv[1:])\n"
    code += f"print(*[name for name in {(*HEAVY_MODULES, 'pydantic')} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code, argument], capture_output=True, text=True, check=True)
    assert found.stdout.startswith(answer)
    assert found.stdout.splitlines()[-1] == "", "heavy modules were loaded"


def test_help_of_every_command_loads_no_heavy_module() -> None:
    """Typer itself may use pydantic to convert the values of options."""
    code = "import sys; from asfm.cli import run_command_line\n"
    code += f"for name in {COMMANDS}: assert run_command_line([name, '--help']) == 0\n"
    code += f"print(*[name for name in {HEAVY_MODULES} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert all(f"Usage: asfm {name} " in found.stdout for name in COMMANDS)
    assert found.stdout.splitlines()[-1] == "", "heavy modules were loaded"


def test_refused_inputs_wait_for_no_heavy_library(tmp_path: Path) -> None:
    """A refusal takes less than a second, most of it the import of NumPy and pydantic."""
    folder, scenario = tmp_path / "sequence", tmp_path / "sonar.json"
    folder.mkdir()
    (folder / "sequence.yaml").write_text("a: [", encoding="utf-8")
    scenario.write_text("{", encoding="utf-8")
    refused = (
        ("info", str(folder)),
        ("run", str(folder), "--output", str(tmp_path / "out")),
        ("run", str(folder), "--output", str(tmp_path / "out"), "--set", "ssl.radius_px=1e9"),
        ("convert", str(folder), str(tmp_path / "out")),
        ("evaluate", str(folder)),
        ("simulate", "seafloor", "--sonar", str(scenario), "--output", str(tmp_path / "out")),
    )
    code = "import sys; from asfm.cli import run_command_line\n"
    code += f"for arguments in {refused}: assert run_command_line(arguments) == 2, arguments\n"
    code += "print(*{'scipy', 'cv2', 'skimage', 'sklearn', 'gtsam', 'rerun', 'trimesh', 'h5py'} & set(sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "\n", "heavy modules were loaded"


def test_module_and_main_run_the_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    found = subprocess.run([sys.executable, "-m", "asfm", "rum"], capture_output=True, text=True, check=False)
    assert (found.returncode, found.stdout) == (2, "")
    assert found.stderr == "asfm: No such command 'rum'. Did you mean 'run'?; see asfm --help\n"
    with pytest.raises(SystemExit) as left:
        main(["--version"])
    assert left.value.code == 0 and __version__ in capsys.readouterr().out


def test_help_without_arguments_lists_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert run_command_line([]) == 0
    text = capsys.readouterr().out
    assert all(f"  {name} " in text for name in COMMANDS)
    assert "..." not in text.partition("Commands:")[2], "a summary of a command is truncated"


def test_closed_pipe_prints_no_error(sequence_folder: Path) -> None:
    command = f"{shlex.quote(sys.executable)} -m asfm info {shlex.quote(str(sequence_folder))} | true"
    found = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert found.stderr == ""
