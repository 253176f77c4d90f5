"""Increments of a database as files: what is written is read again, and each kind of mistake is refused."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from edl_filter.aero.database import load_database
from edl_filter.aero.discrepancy import DiscrepancyPrior
from edl_filter.aero.increment_tables import IncrementTables
from edl_filter.aero.increments import DatabaseUpdate, RegimeUpdate
from edl_filter.aero.increments_file import read_increments
from edl_filter.errors import InputError
from edl_filter.results.database_update import write_update

MACH, ALPHA = np.array([2.0, 2.5, 3.0]), np.radians([0.0, 2.0, 4.0])


def update():
    random = np.random.default_rng(1)
    shape = (3, 3, 3)
    prior_sigma = np.broadcast_to(np.array([0.02, 0.004, 0.001])[:, None, None], shape).copy()
    prior_sigma[1:, :, 0] = 0.0
    scale = prior_sigma.ravel()
    root = random.normal(size=(27, 27)) / 12.0
    covariance = (root @ root.T) * np.outer(scale, scale)
    sigma = np.sqrt(np.diag(covariance)).reshape(shape)
    increment = prior_sigma * random.normal(size=shape)
    regime = RegimeUpdate("mach", MACH, ALPHA, increment, sigma, prior_sigma, np.arange(9).reshape(3, 3))
    return DatabaseUpdate("MER", DiscrepancyPrior(scale=1.0), (regime,), covariance)


@pytest.fixture
def file(tmp_path):
    write_update(update(), tmp_path)
    return tmp_path / "database_update.nc"


def test_what_is_written_is_read_again(file):
    written, read = update(), read_increments(file, "MER")
    assert np.allclose(read.covariance, written.covariance, rtol=1e-12, atol=0.0)
    assert read.family == "MER" and read.cells == 9
    assert read.prior.angle_length == pytest.approx(written.prior.angle_length)
    for name in ("nodes", "alpha", "increment", "sigma", "prior_sigma", "bins", "share"):
        assert np.allclose(getattr(read.regimes[0], name), getattr(written.regimes[0], name), rtol=1e-12, atol=1e-15)


def test_the_table_has_the_form_of_the_databases_own(file):
    lines = (file.parent / "tables" / "database_update.csv").read_text().splitlines()
    assert lines[0].startswith("mach,alpha_deg,CA,CN,Cm,CA_sigma") and len(lines) == 10
    values = np.array([line.split(",") for line in lines[1:]], float)
    assert np.allclose(values[:, 2], update().regimes[0].increment[0].ravel(), rtol=1e-5)
    assert values[:, 0].tolist() == np.repeat(MACH, 3).tolist()


def test_an_update_of_nothing_removes_an_earlier_one(file):
    assert write_update(None, file.parent) == []
    assert not file.exists() and not list((file.parent / "tables").iterdir())


def damage(name, value=None, **attributes):
    """A function that changes a dataset, or attributes of it or of the group."""

    def change(file):
        group = file["database_update"]
        if value is not None:
            group[name][...] = value(group[name][()])
        (group[name] if name else group).attrs.update(attributes)

    return change


def remove(name):
    def change(file):
        del file["database_update"][name]

    return change


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (damage("", family="Phoenix"), ("family", "'Phoenix'", "increments of MER")),
        (damage("", angle_length_deg=0.0), ("angle_length_deg", "found 0", "above 0")),
        (damage("", log_mach_length=-0.5), ("log_mach_length", "-0.5", "above 0")),
        (damage("mach/alpha_deg", units="rad"), ("alpha_deg", "'rad'", "'deg'")),
        (damage("mach/CN", units="N"), ("CN", "'N'", "'1'")),
        (damage("mach/mach", lambda v: v[::-1]), ("mach", "increasing")),
        (damage("mach/alpha_deg", lambda v: v + 1.0), ("angles from 1 to 5", "from 0")),
        (damage("mach/CA", lambda v: v * np.nan), ("CA", "not finite")),
        (remove("mach/Cm_sigma"), ("Cm_sigma", "found nothing")),
        (remove("mach"), ("mach", "knudsen")),
        (damage("covariance", lambda v: -v), ("covariance", "eigenvalue", "positive definite")),
        (damage("covariance", lambda v: v + np.triu(np.full(v.shape, 1e-4))), ("covariance", "symmetric")),
    ],
)
def test_mistakes_are_refused_with_file_key_and_what_is_accepted(file, change, parts):
    with h5py.File(file, "r+") as opened:
        change(opened)
    with pytest.raises(InputError) as error:
        read_increments(file, "MER", "mission.yaml: aerodynamics.increments")
    for part in ("mission.yaml: aerodynamics.increments", str(file), "expected", *parts):
        assert part in str(error.value)


def test_files_of_another_kind_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_increments(tmp_path / "absent.nc")
    text = tmp_path / "table.nc"
    text.write_text("mach,alpha_deg,CA,CN,Cm\n")
    with pytest.raises(InputError, match="no HDF5 file"):
        read_increments(text)
    with h5py.File(tmp_path / "result.nc", "w") as file:
        file.attrs["format"] = "edl-result"
    with pytest.raises(InputError, match="found 'edl-result'"):
        read_increments(tmp_path / "result.nc")


def test_a_database_with_increments_is_the_sum_of_both():
    database, tables = load_database(family="MER"), IncrementTables(update())
    with_increments, regime = replace(database, increments=tables), update().regimes[0]
    mach, alpha = np.meshgrid(MACH, ALPHA, indexing="ij")
    knudsen = np.full(mach.shape, 1e-5)
    sums, own = (d.lookup(mach, knudsen, alpha) for d in (with_increments, database))
    for k, name in enumerate(("ca", "cn", "cm_nose")):
        assert np.allclose(getattr(sums, name) - getattr(own, name), regime.increment[k], rtol=0.0, atol=1e-14)
    far = with_increments.lookup(25.0, 1e-5, 0.03), database.lookup(25.0, 1e-5, 0.03)
    assert far[0].ca == far[1].ca and not far[0].outside
    rarefied = with_increments.lookup(2.5, 1e-2, 0.03), database.lookup(2.5, 1e-2, 0.03)
    assert rarefied[0].ca == rarefied[1].ca


def test_modes_and_remainder_have_the_variance_of_the_increments_and_of_the_prior():
    tables = IncrementTables(update())
    modes = tables.modes[0].reshape(len(tables.modes[0]), -1)
    scale = update().regimes[0].prior_sigma.max(axis=(1, 2)).repeat(9)
    difference = (modes.T @ modes - update().covariance) / np.outer(scale, scale)
    assert np.max(np.abs(difference)) < 1.1e-3  # modes with less variance are left out
    mach = np.array([2.5, np.sqrt(2.5 * 3.0), 3.0 * np.exp(0.5), 60.0, 2.5])
    knudsen, alpha = np.array([1e-5, 1e-5, 1e-5, 1e-5, 1e-2]), np.array([0.0, 0.0, 0.0, 0.0, 0.0])
    remainder = tables.remainder(mach, knudsen, alpha, 1e-3)
    assert remainder[0] < 0.02 and remainder[1] < 0.05
    one_length = (1.0 + np.sqrt(3.0)) * np.exp(-np.sqrt(3.0))
    assert remainder[2] == pytest.approx(1.0 - one_length**2, abs=0.025)  # and what lies between the angles
    assert remainder[3] > 0.999 and remainder[4] == 1.0
