"""NetCDF files in ArviZ's groups: read as they are, or one line with group, variable and dims."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from tests.cli.inside import Said, inside

from gaugeblock.auditing.trials_from import any_trials, trials_from_arviz
from gaugeblock.core.errors import InputError


def layout(drawn) -> dict[str, xr.Dataset]:
    chains = drawn.chains
    return {
        "posterior": xr.Dataset(
            {
                "mu": (("trial", "chain", "draw"), chains[..., 0]),
                "tau": (("trial", "chain", "draw", "k"), chains[..., 1:]),
            }
        ),
        "constant_data": xr.Dataset(
            {"mu": (("mu_dim_0",), drawn.theta[:, 0]), "tau_true": (("n", "m"), drawn.theta[:, 1:])}
        ),
        "observed_data": xr.Dataset({"y": (("trial", "channel"), drawn.x)}),
    }


def written(groups: dict[str, xr.Dataset], path: Path) -> Path:
    """Group after group, as InferenceData wrote them."""
    for number, (name, dataset) in enumerate(groups.items()):
        dataset.to_netcdf(path, mode="a" if number else "w", group=name, engine="netcdf4")
    return path


def read(path: Path) -> xr.Dataset:
    return any_trials(path).to_dataset()


def test_groups_in_a_file_are_the_direct_trials(drawn, tmp_path: Path) -> None:
    trials = read(written(layout(drawn), tmp_path / "fits.nc"))
    assert trials.attrs.pop("autocorrelated") == 1
    xr.testing.assert_identical(trials, drawn.direct)


def test_inference_data_of_old_arviz(drawn, tmp_path: Path) -> None:
    arviz = pytest.importorskip("arviz", exc_type=ImportError)
    if not hasattr(arviz, "InferenceData"):
        pytest.skip("needs arviz before 1.0")
    data = arviz.InferenceData(**layout(drawn), warn_on_custom_groups=False)
    data.to_netcdf(str(tmp_path / "fits.nc"))
    for trials in (trials_from_arviz(data), read(tmp_path / "fits.nc")):
        np.testing.assert_array_equal(trials["draws"].values, drawn.draws)
        np.testing.assert_array_equal(trials["theta_true"].values, drawn.theta)


def test_labels_pair_truths_with_fits_in_any_order(drawn, tmp_path: Path) -> None:
    groups = layout(drawn)
    labels = np.arange(len(drawn.x))[::-1].copy()
    schools = ["Choate", "Deerfield"]
    groups["posterior"] = groups["posterior"].assign_coords(trial=labels, k=schools)
    prior = groups["posterior"].isel(chain=0, draw=0, drop=True) * 0
    prior["mu"] = ("trial", drawn.theta[:, 0])
    prior["tau"] = (("trial", "k"), drawn.theta[:, 1:])
    groups["prior"] = prior.isel(trial=slice(None, None, -1), k=[1, 0])
    trials = read(written(groups, tmp_path / "fits.nc"))
    assert trials["parameter"].values.tolist() == ["mu", "tau[Choate]", "tau[Deerfield]"]
    np.testing.assert_array_equal(trials["theta_true"].values, drawn.theta)


@pytest.mark.parametrize(("name", "draws"), [("simulation", "draw"), ("sample", "draw"), ("trial", "sample")])
def test_the_dim_of_data_sets_has_many_names(name: str, draws: str, drawn, tmp_path: Path) -> None:
    posterior = xr.Dataset({"tau": ((name, draws, "k"), drawn.draws)}, attrs={"a": 1})
    prior = xr.Dataset({"tau": ((name, "k"), drawn.theta)})
    trials = read(written({"posterior": posterior, "prior": prior}, tmp_path / "fits.nc"))
    assert "autocorrelated" not in trials.attrs
    np.testing.assert_array_equal(trials["draws"].values, drawn.draws)
    np.testing.assert_array_equal(trials["theta_true"].values, drawn.theta)


def test_truths_may_be_an_attribute_and_the_dim_may_be_named(drawn) -> None:
    posterior = xr.Dataset(
        {"mu": (("galaxy", "draw"), drawn.draws[..., 0])}, attrs={"mu_true": drawn.theta[:, 0]}
    )
    trials = trials_from_arviz(posterior, trial="galaxy")
    np.testing.assert_array_equal(trials["theta_true"].values[:, 0], drawn.theta[:, 0])
    with pytest.raises(
        InputError, match=r"the dims \(galaxy, draw\), none of which counts simulated data sets"
    ):
        trials_from_arviz(posterior)


def changed(groups: dict[str, xr.Dataset], case: str) -> dict[str, xr.Dataset]:
    posterior, constant = groups["posterior"], groups["constant_data"]
    broken = {
        "one fit": {"posterior": posterior.isel(trial=0)},
        "no draws": {"posterior": posterior.isel(chain=0, draw=0)},
        "ranks": {"prior_sbc": posterior, "posterior": None},
        "no truths": {"constant_data": constant.drop_vars("mu")},
        "fewer truths": {"constant_data": constant.isel(mu_dim_0=slice(0, 9))},
        "a variable of one draw": {"posterior": posterior.assign(mu=posterior["mu"].isel(draw=0))},
        "two dims of data sets": {"posterior": posterior.expand_dims(simulation=2)},
        "labels of others": {
            "posterior": posterior.assign_coords(trial=np.arange(posterior.sizes["trial"])),
            "observed_data": groups["observed_data"].assign_coords(
                trial=np.arange(posterior.sizes["trial"]) + 7
            ),
        },
    }[case]
    return {name: dataset for name, dataset in {**groups, **broken}.items() if dataset is not None}


CASES = {
    "one fit": r"group posterior has the dims \(chain, draw, k\), none of which counts simulated data sets",
    "no draws": r"group posterior has the dims \(trial, k\); draws need \(chain, draw\)",
    "ranks": "group prior_sbc holds ranks",
    "no truths": "no truths of mu: looked for mu and mu_true in the groups prior and constant_data",
    "fewer truths": r"group constant_data, variable mu has the dims \(mu_dim_0: 9\); expected .* 400 sim",
    "a variable of one draw": r"group posterior, variable mu has the dims \(trial, chain\); expected \(trial",
    "two dims of data sets": "trial and simulation may each be the simulated data sets",
    "labels of others": "group observed_data, variable y: the labels of dim trial are not those",
}


@pytest.mark.parametrize("case", CASES)
def test_what_cannot_be_mapped_is_one_line(case: str, drawn, tmp_path: Path) -> None:
    path = written(changed(layout(drawn), case), tmp_path / "fits.nc")
    with pytest.raises(InputError, match=CASES[case]) as caught:
        any_trials(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))


def test_the_command_reads_them(narrow, tmp_path: Path) -> None:
    def audit(path: Path) -> Said:
        options = ("--quiet", "--validator", "sbc", "--out", tmp_path / "out")
        return inside("audit", "--trials", path, *options)

    bad = audit(written(layout(narrow), tmp_path / "narrow.nc"))
    assert bad.returncode == 1, bad.stdout + bad.stderr
    assert "sbc.log_width[tau[1]]" in bad.stdout
    refused = audit(written(changed(layout(narrow), "one fit"), tmp_path / "one.nc"))
    assert refused.returncode == 2
    assert len(refused.stderr.strip().splitlines()) == 1
    assert "none of which counts simulated data sets" in refused.stderr
