"""What is demanded of a scan: on the threshold, told in words, silent where nothing is demanded."""

import numpy as np
import pytest

from scan2fea.errors import UsageError
from scan2fea.kernel.noise import spacing
from scan2fea.pipeline.config import Config, load_config, to_toml
from scan2fea.pipeline.requires import RequireOptions, conditions, noise_checks, spacing_checks, thinnest_wall
from scan2fea.types import PointCloud

GRID = np.stack(np.meshgrid(np.arange(20) * 0.01, np.arange(20) * 0.01, [0.0]), axis=-1).reshape(-1, 3)


def test_nothing_is_demanded_by_default():
    assert spacing_checks(PointCloud.of(GRID), RequireOptions()) == [] and noise_checks(1.0, RequireOptions()) == []
    assert "[require]" in to_toml(Config()) and 'spacing_m = "auto"' in to_toml(Config())


def test_spacing_on_the_threshold():
    found = spacing(GRID)
    (check,) = spacing_checks(PointCloud.of(GRID), RequireOptions(spacing_m=found))
    assert check.passed and (check.name, check.value, check.limit, check.unit) == ("require.spacing", found, found, "m")
    (check,) = spacing_checks(PointCloud.of(GRID), RequireOptions(spacing_m=found * (1 - 1e-12)))
    assert not check.passed and "the points are" in check.says and "require.spacing_m" in check.says


def test_inferred_points_do_not_count():
    dense = np.concatenate([GRID, GRID + 0.001, GRID + 0.002])
    inferred = np.arange(len(dense)) >= len(GRID)
    (check,) = spacing_checks(PointCloud.of(dense, is_inferred=inferred), RequireOptions(spacing_m=1.0))
    assert check.value == spacing(GRID)


def test_noise_on_the_threshold_and_where_it_is_not_known():
    options = RequireOptions(noise_m=0.002)
    assert noise_checks(0.002, options)[0].passed
    assert noise_checks(0.00201, options)[0].says.startswith("the noise of the points is 2.01 mm; require.noise_m = 2 mm was demanded")
    assert not noise_checks(float("nan"), options)[0].passed


def test_it_is_an_option_like_any_other():
    assert load_config(None, {"require.spacing_m": "0.004"}).require.spacing_m == 0.004
    with pytest.raises(UsageError, match=r"require\.noise_m"):
        load_config(None, {"require.noise_m": "-1"})


def test_the_thinnest_wall_is_that_of_spacing_or_noise():
    limit = conditions()
    assert thinnest_wall(0.0063, float("nan")) == pytest.approx(0.0063 / limit["spacing_walls"])
    assert thinnest_wall(0.001, 0.002) == pytest.approx(0.002 / limit["noise_walls"])
