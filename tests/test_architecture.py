"""Rules for the whole package: layers, light imports, printing, safe reading, file sizes, packaging."""

import ast
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from importlinter.cli import lint_imports

ROOT = Path(__file__).resolve().parents[1]
PACKAGE_FOLDERS = ("asfm", "frontend", "backend")
MAX_LINES = 300
DOCUMENTED_BY_THEIR_BASE = {"find_class"}
"""Methods that override those of the standard library."""
PRINTERS = {
    *("print", "pprint", "pprint.pprint", "rich.print", "sys.stdout.write", "sys.stderr.write"),
    *("typer.echo", "typer.secho", "click.echo", "click.secho", "traceback.print_exc"),
}

NEVER_ON_IMPORT = ("gtsam", "rerun", "trimesh", "embreex", "matplotlib", "evo", "torch", "kornia")
NOT_BEFORE_A_COMMAND = (*NEVER_ON_IMPORT, "cv2", "skimage", "sklearn")
LIGHT_MODULES = (
    "asfm",
    "asfm.cli",
    "asfm.sequence",
    "asfm.datasets",
    "asfm.evaluation.pose_error_table",
    "asfm.evaluation.matching",
    "asfm.evaluation.denoising.metrics",
    "asfm.results.report_json",
    "asfm.results.tracks_csv",
    "asfm.results.trajectory_tum",
    "asfm.visualization.rerun_recorder",
    "asfm.visualization.viewer",
)


def package_files() -> list[Path]:
    """Return every file of the package once, not again through the links asfm/frontend and asfm/backend."""
    found = [path for folder in PACKAGE_FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    return [path for path in found if path == path.resolve()]


def python_files() -> list[Path]:
    """Return the files of the package, its tests and its tools."""
    return package_files() + [path for folder in ("tests", "tools") for path in sorted((ROOT / folder).rglob("*.py"))]


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    parts = parts if parts[0] == "asfm" else ("asfm", *parts)
    return ".".join(part for part in parts if part != "__init__")


def nodes(path: Path) -> Iterator[ast.AST]:
    return ast.walk(ast.parse(path.read_text(encoding="utf-8")))


def imported_names(path: Path) -> set[str]:
    """Return the absolute names of all modules that a file imports, anywhere in the file."""
    names: set[str] = set()
    for node in nodes(path):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno} imports relatively"
            names.add(node.module or "")
    return names


def imports_of(path: Path, package: str) -> bool:
    return any(name.split(".")[0] == package for name in imported_names(path))


def where(path: Path, node: ast.AST) -> str:
    return f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}"


def called_name(node: ast.AST) -> str:
    """Return the dotted name of the called function, as written."""
    return ast.unparse(node.func) if isinstance(node, ast.Call) else ""


def loaded_after_import(modules: list[str], heavy: tuple[str, ...]) -> list[str]:
    """Import modules in a fresh interpreter and return the heavy modules that this loads."""
    code = f"import sys, {', '.join(modules)}; print(*[name for name in {heavy!r} if name in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    return run.stdout.split()


def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_imports_follow_the_layers(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    failed = lint_imports(config_filename="pyproject.toml", no_cache=True, no_logo=True)
    assert failed == 0, capsys.readouterr().out


@pytest.mark.parametrize("package", ["frontend", "backend"])
def test_bare_names_of_other_distributions_are_never_imported(package: str) -> None:
    assert [path for path in python_files() if imports_of(path, package)] == []


def test_frontend_and_backend_do_not_import_each_other() -> None:
    for here, there in (("frontend", "asfm.backend"), ("backend", "asfm.frontend")):
        files = [path for path in package_files() if path.is_relative_to(ROOT / here)]
        assert files
        assert [path for path in files if any(name.startswith(there) for name in imported_names(path))] == []


def test_only_the_visualization_imports_rerun() -> None:
    users = [path for path in package_files() if imports_of(path, "rerun")]
    assert users and {path.parent for path in users} == {ROOT / "asfm" / "visualization"}


def test_evo_is_never_imported_at_run_time() -> None:
    assert [path for path in package_files() if imports_of(path, "evo")] == []
    assert not any(name.startswith("evo") for name in project()["project"]["dependencies"])


def test_only_backend_pipeline_and_studies_load_gtsam() -> None:
    modules = [module_name(path) for path in package_files() if path.name != "__main__.py"]
    users = ("asfm.backend", "asfm.pipeline", "asfm.study", "asfm.commands.study")
    solving = [name for name in modules if name.startswith(users)]
    others = [name for name in modules if name not in solving]
    assert len(others) > 20
    assert loaded_after_import(others, NEVER_ON_IMPORT) == []
    assert set(loaded_after_import(solving, NEVER_ON_IMPORT)) <= {"gtsam"}


@pytest.mark.parametrize("module", LIGHT_MODULES)
def test_light_modules_load_nothing_heavy(module: str) -> None:
    assert loaded_after_import([module], NOT_BEFORE_A_COMMAND) == []


def test_importing_the_package_loads_none_of_its_modules_and_no_other_package() -> None:
    """The public names are imported at their first use."""
    code = "import sys; before = set(sys.modules); import asfm; print(*sorted(set(sys.modules) - before))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = run.stdout.split()
    assert "asfm" in loaded
    assert [name for name in loaded if name.split(".")[0] not in sys.stdlib_module_names] == ["asfm"]


def test_only_the_command_line_prints() -> None:
    printing = [
        (path, where(path, node)) for path in package_files() for node in nodes(path) if called_name(node) in PRINTERS
    ]
    folder = ROOT / "asfm" / "cli"
    assert any(path.is_relative_to(folder) for path, _ in printing), "the guard does not see the printing functions"
    assert [place for path, place in printing if not path.is_relative_to(folder)] == []


def test_everything_public_has_a_docstring() -> None:
    offences: list[str] = []
    for path in package_files():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        if ast.get_docstring(tree) is None:
            offences.append(f"{path.relative_to(ROOT)} itself")
        bodies = [tree.body] + [node.body for node in tree.body if isinstance(node, ast.ClassDef)]
        for node in (node for body in bodies for node in body):
            if not isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                continue
            public = not node.name.startswith("_") and node.name not in DOCUMENTED_BY_THEIR_BASE
            if public and ast.get_docstring(node) is None:
                offences.append(f"{where(path, node)} {node.name}")
    assert offences == []


def test_files_stay_small() -> None:
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines()) for path in package_files()
    }
    assert {name: length for name, length in lengths.items() if length > MAX_LINES} == {}


def test_input_files_are_never_executed() -> None:
    forbidden = {"eval", "exec", "pickle.load", "pickle.loads", "yaml.load", "yaml.unsafe_load", "yaml.full_load"}
    offences = [
        where(path, node)
        for path in package_files()
        for node in nodes(path)
        if called_name(node) in forbidden
        or (isinstance(node, ast.keyword) and node.arg == "allow_pickle" and ast.unparse(node.value) != "False")
        or (isinstance(node, ast.keyword) and node.arg == "shell" and ast.unparse(node.value) != "False")
    ]
    assert offences == []


def test_randomness_is_an_argument() -> None:
    """Neither the global generator of NumPy nor a generator seeded by the clock is used."""
    allowed = {"np.random.default_rng", "np.random.Generator", "np.random.SeedSequence"}
    offences = [
        where(path, node)
        for path in package_files()
        for node in nodes(path)
        if isinstance(node, ast.Call)
        and called_name(node).startswith(("np.random.", "random."))
        and (called_name(node) not in allowed or not (node.args or node.keywords))
    ]
    assert offences == []


def test_no_absolute_path_of_a_machine_is_in_the_tree() -> None:
    folders = [f"/{name}/" for name in ("work", "tmp", "root", "home", "Users", "mnt")]
    suffixes = {".md", ".toml", ".yaml", ".yml", ".cff", ""}
    texts = [path for path in ROOT.iterdir() if path.is_file() and path.suffix in suffixes and path.name != ".coverage"]
    texts += [path for folder in ("tests", "tools") for path in (ROOT / folder).rglob("*.yaml")]
    offences = [
        f"{path.relative_to(ROOT)}:{number}"
        for path in python_files() + texts
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if any(folder in line for folder in folders)
    ]
    assert offences == []


def test_both_linked_folders_install_as_parts_of_the_package() -> None:
    setuptools = project()["tool"]["setuptools"]
    packages = {module_name(path) for path in package_files() if path.name == "__init__.py"}
    assert set(setuptools["packages"]) == packages
    for name in ("frontend", "backend"):
        assert setuptools["package-dir"][f"asfm.{name}"] == name
        assert (ROOT / "asfm" / name).resolve() == ROOT / name
        imported = import_module(f"asfm.{name}").__file__
        assert imported is not None
        assert Path(imported).parent.name == name


def test_run_time_imports_are_declared() -> None:
    distributions = {
        "cv2": "opencv-python-headless",
        "dask_jobqueue": "dask-jobqueue",
        "skimage": "scikit-image",
        "sklearn": "scikit-learn",
        "yaml": "pyyaml",
        "rerun": "rerun-sdk",
    }
    meta = project()["project"]
    extras = [name for key, names in meta["optional-dependencies"].items() if key != "dev" for name in names]
    declared = " ".join(meta["dependencies"] + extras)
    known = set(sys.stdlib_module_names) | {"asfm"}
    names = {name.split(".")[0] for path in package_files() for name in imported_names(path)} - known
    assert {name for name in names if distributions.get(name, name) not in declared} == set()


def names_imported_from(path: Path, module: str) -> set[str]:
    found = (node for node in nodes(path) if isinstance(node, ast.ImportFrom) and node.module == module)
    return {alias.name for node in found for alias in node.names}


@pytest.mark.parametrize(
    ("package", "foreign"),
    [
        ("backend", {"Keypoints", "Matches", "ExternalMatches", "Descriptors", "Frame"}),
        ("frontend", {"Landmarks", "Reconstruction", "Trajectory", "Navigation"}),
    ],
)
def test_tracks_are_the_only_interface_of_front_end_and_back_end(package: str, foreign: set[str]) -> None:
    files = [path for path in package_files() if path.is_relative_to(ROOT / package)]
    used = [names_imported_from(path, "asfm.types") for path in files]
    assert any("Tracks" in names for names in used)
    assert {path.name: names & foreign for path, names in zip(files, used, strict=True) if names & foreign} == {}
