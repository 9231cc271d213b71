"""``asfm simulate`` with invalid input: a one-line error, exit code 2, and no files left."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest
import trimesh

from asfm.cli import run_command_line
from asfm.commands import describe_sequence
from asfm.datasets import open_sequence

LEVEL = "0 0 0 1"
SMALL = {"RangeMax": 8, "RangeMin": 0.5, "RangeBins": 60, "AzimuthBins": 32, "Azimuth": 70, "ElevationBins": 40}


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working directory with a ball of 2 m radius and a small sonar."""
    monkeypatch.chdir(tmp_path)
    trimesh.creation.icosphere(subdivisions=2, radius=2.0).export(tmp_path / "ball.ply")
    sonar = {"sensor_type": "ImagingSonar", "configuration": SMALL}
    (tmp_path / "small.json").write_text(json.dumps({"agents": [{"sensors": [sonar]}]}))
    return tmp_path


@pytest.fixture
def ask(place: Path, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Return a function that runs ``asfm simulate`` into a folder and returns exit code and stderr."""

    def run(scene: str, *options: str, output: str = "out") -> tuple[int, str]:
        small = () if "--sonar" in options else ("--sonar", "small.json")
        code = run_command_line(["simulate", scene, "--output", output, *small, *options])
        return code, capsys.readouterr().err

    return run


FAULTS: list[tuple[str, tuple[str, ...], str | None, str]] = [
    ("moon", (), None, "unknown scene 'moon'; known: seafloor, pier, hull, wreck, tank, or a mesh file"),
    ("gone.obj", (), None, "gone.obj: expected a mesh file, found none"),
    ("data.obj", (), "", "data.obj: expected a mesh file, found an empty file"),
    ("data.obj", (), "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "data.obj: expected finite vertices"),
    ("data.obj", (), "v 1e9 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "data.obj: expected a mesh in metres"),
    ("data.png", (), "picture", "data.png: expected a mesh such as .obj"),
    (".", (), None, ".: expected a mesh file, found a folder"),
    ("tank", ("--sonar", "ear"), None, "unknown sonar preset 'ear'; known: oculus_m750d_high, "),
    ("tank", ("--sonar", "gone.json"), None, "gone.json: expected a HoloOcean scenario, found none"),
    ("tank", ("--sonar", "data.json"), '{"agents": [', "data.json: cannot read a HoloOcean scenario"),
    ("tank", ("--sonar", "data.json"), "[]", "data.json: expected a HoloOcean scenario with a list of agents"),
    (
        "tank",
        ("--sonar", "data.json"),
        '{"agents": [7, {"sensors": [3, {"sensor_type": "RGBCamera"}]}]}',
        "data.json: expected a sensor_type of ImagingSonar, found RGBCamera",
    ),
    (
        "tank",
        ("--sonar", "data.json"),
        '{"agents": [{"sensors": [{"sensor_type": "ImagingSonar", "configuration": {"RangeMxa": 5}}]}]}',
        "data.json: unknown sonar parameter 'RangeMxa'; known: RangeMin, RangeMax",
    ),
    ("tank", ("--motion", "dance"), None, "unknown motion 'dance'; known: sway, "),
    ("tank", ("--motion", "."), None, ".: expected a motion's name or a path in TUM format, found a folder"),
    ("tank", ("--motion", "gone.tum"), None, "gone.tum: expected a table, found none"),
    ("tank", ("--motion", "data.tum"), "", "data.tum: expected rows of timestamp_s x y z"),
    ("tank", ("--motion", "data.tum"), "0 1 2\n", "data.tum, line 1: expected 8 numbers"),
    ("tank", ("--motion", "data.tum"), f"0 nan 0 1 {LEVEL}\n", "data.tum, line 1: expected a finite x, found nan"),
    ("tank", ("--motion", "data.tum"), f"1 0 0 1 {LEVEL}\n0 0 0 1 {LEVEL}\n", "data.tum, line 2: .* stamps must rise"),
    ("tank", ("--motion", "data.tum"), "0 0 0 1 0 0 0 0\n", "data.tum, line 1: expected a unit quaternion"),
    ("tank", ("--motion", "data.tum"), f"0 1e9 0 1 {LEVEL}\n", r"at frame 0 the sonar is 1e\+09 m away"),
    (
        "ball.ply",
        ("--motion", "data.tum"),
        f"0 -5 0 0 {LEVEL}\n5 0 0 0 {LEVEL}\n",
        "at frame 1[56] .* is inside an object",
    ),
    ("hull", ("--motion", "data.tum"), f"0 0 0 1.5 {LEVEL}\n", "scene hull: at frame 0 .* is inside an object"),
    ("ball.ply", ("--frames", "0"), None, "expected at least one frame to simulate, found 0"),
    ("ball.ply", ("--frames", "-3"), None, "expected at least one frame to simulate, found -3"),
    ("ball.ply", ("--frames", "1000000000"), None, "expected 1000000 frames to simulate at most, found 1000000000"),
    ("ball.ply", ("--frames", "1.5"), None, "'--frames'"),
    ("ball.ply", ("--seed", "-1"), None, "expected a seed of zero or more, found -1"),
    ("ball.ply", ("--format", "rosbag"), None, "unknown format 'rosbag' to write; known: native, holoocean"),
    ("tank", ("--sonar", "didson", "--format", "holoocean", "--frames", "1"), None, "has uneven beams"),
]


@pytest.mark.parametrize(("scene", "options", "content", "message"), FAULTS)
def test_invalid_input_is_a_one_line_error_and_leaves_no_files(
    place: Path,
    ask: Callable[..., tuple[int, str]],
    scene: str,
    options: tuple[str, ...],
    content: str | None,
    message: str,
) -> None:
    if content is not None:
        name = next(word for word in (scene, *options) if word.startswith("data."))
        (place / name).write_text(content)
    before = sorted(place.iterdir())
    code, complaint = ask(scene, *options)
    assert code == 2, complaint
    assert complaint.count("\n") == 1 and "Traceback" not in complaint
    assert re.search(message, complaint), complaint
    assert sorted(place.iterdir()) == before


def test_existing_files_are_not_touched(place: Path, ask: Callable[..., tuple[int, str]]) -> None:
    (place / "file").write_text("mine")
    (place / "full").mkdir()
    (place / "full" / "notes.txt").write_text("mine")
    for output, message in (("file", "found a file"), ("full", "found notes.txt"), ("file/deeper", "cannot make")):
        for options in ((), ("--overwrite",)):
            code, complaint = ask("ball.ply", "--frames", "1", *options, output=output)
            assert code == 2 and message in complaint and complaint.count("\n") == 1
    assert (place / "file").read_text() == (place / "full" / "notes.txt").read_text() == "mine"
    assert not list(place.glob("*partial*"))


def test_path_shorter_than_the_frames_is_a_warning(place: Path, ask: Callable[..., tuple[int, str]]) -> None:
    (place / "one.tum").write_text(f"3.5 -5 0 0 {LEVEL}\n")
    code, stderr = ask("ball.ply", "--frames", "4", "--motion", "one.tum")
    assert code == 0 and "warning: the path ends after 1 of 4 frames at 5 Hz" in stderr
    sequence = open_sequence(place / "out")
    assert len(sequence) == 1 and sequence.timestamps_s[0] == pytest.approx(3.5)


def test_empty_view_gives_a_valid_sequence(place: Path, ask: Callable[..., tuple[int, str]]) -> None:
    (place / "away.tum").write_text("0 -5 0 0 0 0 1 0\n1 -5 1 0 0 0 1 0\n")
    code, stderr = ask("ball.ply", "--frames", "2", "--motion", "away.tum")
    assert (
        code == 0
        and "warning: 2 of 2 frames see nothing of ball within 8.0 m; it is 4 m across" in stderr
        and "[empty-frames]" in stderr
    )
    sequence = open_sequence(place / "out")
    assert len(sequence) == 2 and max(frame.image.max() for frame in sequence) == 0  # HoloOcean's sonar: no noise


@pytest.mark.filterwarnings("error")
def test_looking_straight_down_gives_no_warning(place: Path, ask: Callable[..., tuple[int, str]]) -> None:
    (place / "down.tum").write_text("0 0 0 5 0 0.70710678 0 0.70710678\n1 0.2 0 5 0 0.70710678 0 0.70710678\n")
    code, stderr = ask("ball.ply", "--frames", "2", "--motion", "down.tum")
    assert code == 0 and "warning" not in stderr.lower()
    assert open_sequence(place / "out").navigation is not None


def test_both_formats_have_the_same_description(place: Path, ask: Callable[..., tuple[int, str]]) -> None:
    descriptions = []
    for output, name in (("native", "native"), ("pickled", "holoocean")):
        assert ask("ball.ply", "--frames", "3", "--format", name, output=output)[0] == 0
        descriptions.append(dict(describe_sequence(place / output)))
    native, pickled = descriptions
    same = [key for key in native if key in pickled and native[key] == pickled[key]]
    assert {"frames", "range", "bearing"} <= {key.split()[0].rstrip(":") for key in same}, (native, pickled)


@pytest.mark.parametrize("option", ["scene", "--sonar", "--motion", "--format"])
def test_a_name_of_any_length_is_quoted_in_80_characters(ask: Callable[..., tuple[int, str]], option: str) -> None:
    name = "x" * 300
    code, message = ask(name) if option == "scene" else ask("seafloor", option, name)
    assert code == 2 and message.count("\n") == 1
    assert 60 < message.count("x") < 90 and "known: " in message
