import tomllib

import pytest

from scan2fea.errors import InputError, UsageError
from scan2fea.pipeline.config import Config, as_tree, from_tree, known_keys, load_config, to_toml


def test_printed_configuration_reads_back_as_itself(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(to_toml())
    assert load_config(path) == Config()


def test_every_option_is_explained():
    explained = [line for line in to_toml().splitlines() if line.startswith("#")]
    assert len(explained) >= len(known_keys())


def test_unit_is_the_first_key_that_speaks_of_a_unit():
    assert "unit" in tomllib.loads(to_toml())["input"]


def test_set_wins_over_file(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text("[run]\nseed = 3\njobs = 1\n")
    config = load_config(path, {"run.seed": "7"})
    assert (config.run.seed, config.run.jobs) == (7, 1)


def test_one_word_is_a_list_of_one():
    assert load_config(None, {"select.kinds": "support"}).select.kinds == ("support",)
    assert load_config(None, {"select.kinds": '["support", "object"]'}).select.kinds == ("support", "object")


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("run.sed", "1", "did you mean 'run.seed'"),
        ("segmentation.method", "eucledian", "did you mean 'euclidean'"),
        ("select.kinds", "3", "expected a list"),
        ("input.unit", "feet", "use one of m, mm"),
        ("segmentation.method", "magic", "use one of euclidean, kmeans, "),
        ("seed", "1", "not known"),
        ("run", "1", "not known"),
        ("run.seed.deep", "1", "not known"),
        ("run.seed", "-1", "least allowed is 0"),
        ("run.seed", "1.5", "expected int"),
        ("run.seed", "true", "expected int"),
        ("run.object_seconds", "nan", "finite"),
        ("export.units", "mm", "use one of"),
        ("run.seed", "auto", "no automatic value|expected int"),
    ],
)
def test_wrong_options_are_told(key, value, told):
    with pytest.raises(UsageError, match=told):
        load_config(None, {key: value})


def test_threshold_itself_is_allowed():
    assert load_config(None, {"run.seed": 0}).run.seed == 0


def test_auto_means_from_the_data():
    assert load_config(None, {"run.jobs": "auto"}).run.jobs is None


def test_missing_and_broken_files_are_told(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_config(tmp_path / "none.toml")
    path = tmp_path / "broken.toml"
    path.write_text("[run\n")
    with pytest.raises(UsageError, match="is not TOML"):
        load_config(path)


def test_tree_and_back():
    config = load_config(None, {"run.seed": 5, "input.sensor_position": (1.0, 2.0, 3.0)})
    assert from_tree(as_tree(config)) == config
