"""Docstrings of public functions: shapes and units where arrays are involved, and the errors that they raise."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = ("asfm", "frontend", "backend")
ARRAYS = re.compile(r"\b(FloatArray|IntArray|BoolArray|ImageArray|Descriptors|NDArray|ndarray)\b")
DIMENSION = r"[A-Za-z0-9_+*. /-]+"
SHAPE = re.compile(rf"\({DIMENSION}(, ?{DIMENSION})+\)|\({DIMENSION},\)|\d x \d\b|shape|See :")
"""(N,), (N, 4, 4), (ranges, beams), or a reference to where the shapes are stated."""
REQUIRED_SHARE = 0.95


def public_functions() -> Iterator[tuple[str, ast.FunctionDef]]:
    """Every public function and method of the package, with its place; overloads of dunder methods left out."""
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            if path != path.resolve():
                continue
            tree = ast.parse(path.read_text(encoding="utf-8"))
            bodies = [tree.body, *(node.body for node in tree.body if isinstance(node, ast.ClassDef))]
            for node in (node for body in bodies for node in body):
                if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                    yield f"{path.relative_to(ROOT)}:{node.lineno} {node.name}", node


def annotations(function: ast.FunctionDef) -> str:
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    found = [argument.annotation for argument in arguments] + [function.returns]
    return " ".join(ast.unparse(annotation) for annotation in found if annotation is not None)


def raised(function: ast.FunctionDef) -> bool:
    """Whether the function itself raises an error for its caller."""
    calls = (node.exc for node in ast.walk(function) if isinstance(node, ast.Raise))
    return any(isinstance(exc, ast.Call) and ast.unparse(exc.func) in {"AsfmError", "ValueError"} for exc in calls)


def check(kind: str, function: ast.FunctionDef) -> bool | None:
    """Whether the docstring states what it must; None where nothing is required."""
    text = ast.get_docstring(function) or ""
    if kind == "shapes":
        return bool(SHAPE.search(text)) if ARRAYS.search(annotations(function)) else None
    return bool(re.search(r"Raises:|[Rr]aises ", text)) if raised(function) else None


@pytest.mark.parametrize("kind", ["shapes", "errors"])
def test_public_functions_state_shapes_and_errors(kind: str) -> None:
    checked = [(place, check(kind, function)) for place, function in public_functions()]
    required = [(place, fine) for place, fine in checked if fine is not None]
    assert len(required) > 50
    missing = [place for place, fine in required if not fine]
    assert 1 - len(missing) / len(required) >= REQUIRED_SHARE, "\n".join(missing)
