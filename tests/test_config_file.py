"""Configuration files: they read back the same, and every error is one line that names the key."""

from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from asfm.config import Config
from asfm.config_file import dump_config, load_config
from asfm.errors import AsfmError


def write(folder: Path, text: str) -> Path:
    path = folder / "settings.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def message_of(path: Path | None = None, *overrides: str) -> str:
    with pytest.raises(AsfmError) as caught:
        load_config(path, overrides)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 600
    return message


def test_defaults_need_no_file() -> None:
    assert load_config() == Config()


@pytest.mark.parametrize("text", ["", "# all left out\n", "cfar:\n", "cfar: {}\n", "seed: 0\n"])
def test_missing_keys_keep_their_defaults(tmp_path: Path, text: str) -> None:
    assert load_config(write(tmp_path, text)) == Config()


@given(
    seed=st.integers(0, 2**40),
    probability=st.floats(1e-12, 1, exclude_max=True),
    guard=st.tuples(st.integers(0, 20), st.integers(0, 20)),
    wider=st.tuples(st.integers(1, 20), st.integers(1, 20)),
    use_odometry=st.booleans(),
)
def test_dump_reads_back_the_same(
    tmp_path_factory: pytest.TempPathFactory,
    seed: int,
    probability: float,
    guard: tuple[int, int],
    wider: tuple[int, int],
    use_odometry: bool,
) -> None:
    reference = [guard[0] + wider[0], guard[1] + wider[1]]
    config = Config.model_validate(
        {
            "seed": seed,
            "cfar": {"false_alarm_probability": probability, "guard_px": guard, "reference_px": reference},
            "backend": {"use_odometry": use_odometry},
        }
    )
    path = write(tmp_path_factory.getbasetemp(), dump_config(config))
    assert load_config(path) == config
    assert dump_config(load_config(path)) == dump_config(config)


def test_dump_names_every_setting() -> None:
    def names(model: BaseModel) -> dict[str, object]:
        fields = ((name, getattr(model, name)) for name in type(model).model_fields)
        return {name: names(value) if isinstance(value, BaseModel) else None for name, value in fields}

    def keys(settings: dict[str, object]) -> dict[str, object]:
        return {name: keys(value) if isinstance(value, dict) else None for name, value in settings.items()}

    assert keys(yaml.safe_load(dump_config(Config()))) == names(Config())


@pytest.mark.parametrize(
    ("old", "new"),
    [("loops.min_likeness", "loops.min_similarity"), ("localisation.spread_factor", "localisation.sigma_scale")],
)
def test_renamed_keys_are_accepted_and_written_with_their_new_name(tmp_path: Path, old: str, new: str) -> None:
    section, key = old.split(".")
    renamed = load_config(write(tmp_path, f"{section}: {{{key}: 0.25}}"))
    assert renamed == load_config(None, (f"{old}=0.25",)) == load_config(None, (f"{new}=0.25",)) != Config()
    assert load_config(write(tmp_path, f"{section}: {{{key}: 0.25}}"), (f"{new}=0.5",)) == load_config(
        None, (f"{new}=0.5",)
    )
    assert key not in dump_config(renamed)


def test_override_precedes_file_and_file_precedes_default(tmp_path: Path) -> None:
    path = write(tmp_path, "seed: 3\nmatching:\n  max_gap: 5\n  ratio: 0.7\n")
    config = load_config(path, ("matching.max_gap=2", "clusters.radius_px=1e0"))
    assert (config.seed, config.matching.max_gap, config.matching.ratio) == (3, 2, 0.7)
    assert config.clusters.radius_px == 1.0
    assert config.ssl == Config().ssl


def test_overrides_are_yaml_values() -> None:
    config = load_config(
        None,
        ("cfar.guard_px=[1, 2]", "backend.use_odometry=false", "cfar.false_alarm_probability=1e-3", "seed = 7"),
    )
    assert config.cfar.guard_px == (1, 2)
    assert config.backend.use_odometry is False
    assert config.cfar.false_alarm_probability == 1e-3
    assert config.seed == 7


def test_override_of_an_empty_section_of_the_file(tmp_path: Path) -> None:
    assert load_config(write(tmp_path, "ssl:\n"), ("ssl.radius_px=3",)).ssl.radius_px == 3


def test_unknown_key_error_lists_the_keys_of_the_section(tmp_path: Path) -> None:
    message = message_of(write(tmp_path, "matching:\n  max_gaps: 3\n"))
    assert "settings.yaml" in message
    assert "matching.max_gaps" in message
    assert "max_gap, planar_tolerance, ratio" in message


def test_unknown_section_error_lists_the_sections() -> None:
    message = message_of(None, "matcher.max_gap=3")
    assert "'matcher'" in message
    assert "matching" in message


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("seed=many", ("seed", "integer", "many")),
        ("seed=1.5", ("seed", "integer", "1.5")),
        ("seed=-1", ("seed", "-1")),
        ("cfar=3", ("cfar", "3")),
        ("cfar.guard_px=3", ("cfar.guard_px", "3")),
        ("cfar.guard_px=[1]", ("cfar.guard_px",)),
        ("cfar.false_alarm_probability=1", ("cfar.false_alarm_probability", "less than 1")),
        ("ssl.max_loss=.nan", ("ssl.max_loss", "nan")),
        ("ssl.max_loss=.inf", ("ssl.max_loss", "finite", "inf")),
        ("matching.max_gap=0", ("matching.max_gap", "0")),
        ("mode=later", ("mode", "batch", "later")),
        ("cfar.guard_px=[9, -1]", ("cfar", "guard_px", "[9, -1]")),
        ("cfar.reference_px=[3, 12]", ("cfar", "reference_px", "[3, 12]")),
        ("cfar.reference_px=[4, 4]", ("cfar", "reference_px", "[4, 4]")),
    ],
)
def test_invalid_value_error_names_key_and_value(override: str, words: tuple[str, ...]) -> None:
    message = message_of(None, override)
    for word in words:
        assert word in message


@pytest.mark.parametrize("override", ["seed", "=3", " =3", ""])
def test_malformed_override_error_states_the_form(override: str) -> None:
    assert "section.key=value" in message_of(None, override)


@pytest.mark.parametrize(
    "value", ["[", "*x", "2001-99-99", "!!python/object:os.system {}", "9" * 5000, "[" * 1500, "!!int x"]
)
def test_override_that_is_not_yaml_is_a_one_line_error(value: str) -> None:
    assert "seed" in message_of(None, f"seed={value}")


def test_override_below_a_value_is_an_error() -> None:
    assert "'matching.ratio'" in message_of(None, "matching.ratio.low=1")
    assert "ratio is a value" in message_of(None, "matching.ratio=1", "matching.ratio.low=1")


@pytest.mark.parametrize("text", ["seed: [", "\tseed: 1", "a: 2001-99-99", "[" * 1500, "? [1]\n: 2\n", "\x00"])
def test_malformed_yaml_error_names_the_file(tmp_path: Path, text: str) -> None:
    assert "settings.yaml" in message_of(write(tmp_path, text))


@pytest.mark.parametrize("text", ["- seed\n", "seed\n", "3\n"])
def test_yaml_without_sections_is_an_error(tmp_path: Path, text: str) -> None:
    message = message_of(write(tmp_path, text))
    assert "settings.yaml" in message
    assert "expected sections" in message


def test_keys_that_are_not_text_are_an_error(tmp_path: Path) -> None:
    assert "settings.yaml" in message_of(write(tmp_path, "1: 2\n"))


def test_missing_file_error_names_the_file(tmp_path: Path) -> None:
    assert "nowhere.yaml" in message_of(tmp_path / "nowhere.yaml")


def test_folder_or_binary_file_is_an_error(tmp_path: Path) -> None:
    assert str(tmp_path) in message_of(tmp_path)
    (tmp_path / "image.yaml").write_bytes(b"\xff\xfe\x00seed")
    assert "image.yaml" in message_of(tmp_path / "image.yaml")


@pytest.mark.parametrize("value", ["1e40", "1e308", "9" * 400, "-1e40"])
def test_every_number_has_bounds_on_both_sides(value: str) -> None:
    for section, model in ((name, getattr(Config(), name)) for name in Config.model_fields):
        for key, found in model if isinstance(model, BaseModel) else ():
            if isinstance(found, int | float) and not isinstance(found, bool):
                assert key in message_of(None, f"{section}.{key}={value}")
