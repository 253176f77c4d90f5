"""Fixtures that find the flights: shipped ones, and their originals where the environment names them."""

import os
import shutil
from importlib.resources import files
from pathlib import Path

import pytest
from hypothesis import settings

# Before numpy is imported: two workers on two cores need one BLAS thread each; more wait for each other, at three times
# the processor time
for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
# Before edl_filter is imported: the workers of pytest use the processors
if "PYTEST_XDIST_WORKER" in os.environ:
    os.environ.setdefault("EDL_FILTER_WORKERS", "1")
# Commands that tests start read the package's modules compiled, as users' commands do, not compile them each time
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Examples are many in all; a compiler's first call must not count as a slow example. A run is reproducible: other
# examples are tried with HYPOTHESIS_PROFILE=explore
settings.register_profile("edl-filter", deadline=None, max_examples=40, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=400)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "edl-filter"))


#: Files that take longest, longest first: a worker that begins one of them last keeps the other waiting.
LONGEST = (
    "flights/test_hidden_effects.py", "workflow/test_diagnose_result.py", "test_docs_types.py",
    "workflow/test_campaign.py", "studies/test_calibration.py", "cli/test_reconstruction.py",
    "report/test_figure_process.py", "test_api.py", "cli/test_new.py", "navigation/test_unresolved.py",
    "pipeline/test_trust.py", "pipeline/test_causes.py", "serve/test_app.py",
    "diagnosis/linear_model/test_credible_model.py", "diagnosis/test_detectability.py",
    "flights/test_effects.py", "estimation/test_autoregression.py",
    "results/test_netcdf.py", "workflow/test_run.py", "diagnosis/linear_model/test_linearization_point.py",
    "flights/test_imu_lever_arms.py", "navigation/test_compiled_ukf.py", "report/test_plots.py",
    "postflight/test_atmosphere.py", "navigation/test_iterated.py", "postflight/test_derive.py",
    "diagnosis/selection/test_map_fit.py", "telemetry/test_sample_repair.py", "report/test_postflight_figures.py",
    "simulation/test_dynamics.py", "cli/test_commands.py", "mission/test_decision_settings.py",
)  # fmt: skip


def pytest_collection_modifyitems(items):
    """Begin with the files that take longest; within a file the order stays."""
    tests = Path(__file__).parent
    rank = {tests / name: k for k, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path, len(LONGEST)))


DATA = Path(__file__).parent / "data"


def _originals(variable, *parts):
    """Folder of original files; the test is skipped where the variable is not set."""
    value = os.environ.get(variable)
    if not value:
        pytest.skip(f"{variable} does not name a folder with the originals, with which this test compares the copies")
    folder = Path(value, *parts)
    if not folder.is_dir():
        pytest.fail(f"{variable} is set, but {folder} is no folder")
    return folder


@pytest.fixture(scope="session", autouse=True)
def consistent_diagnoses():
    """Check every diagnosis of the session: verdict, probabilities and ranking must not contradict each other."""
    from decision_checks import check_all_diagnoses

    with pytest.MonkeyPatch.context() as patch:
        check_all_diagnoses(patch)
        yield


@pytest.fixture(scope="session")
def mer_originals():
    """Folder of the original PDS volume merimu_1001 (``$EDL_FILTER_DATA/pds/mer_imu``)."""
    return _originals("EDL_FILTER_DATA", "pds", "mer_imu")


@pytest.fixture(scope="session")
def mer_folder(tmp_path_factory):
    """Folder of volume merimu_1001: the original, or the same tables written from the package's numbers."""
    if os.environ.get("EDL_FILTER_DATA"):
        return _originals("EDL_FILTER_DATA", "pds", "mer_imu")
    from mer_volume import write_volume

    return write_volume(tmp_path_factory.mktemp("merimu_1001"))


@pytest.fixture(scope="session")
def mevad():
    """Folder of published aerodynamic tables that the package does not ship."""
    return DATA / "mevad"


@pytest.fixture(scope="session")
def practice(builtin_flight):
    """Function that gives the path of practice flight n."""
    return lambda n: builtin_flight if n == 6 else DATA / "practice" / f"practice_{n:02d}.h5"


@pytest.fixture(scope="session")
def practice_originals():
    """Folder of the original practice flights (``$EDL_FILTER_PRACTICE``)."""
    return _originals("EDL_FILTER_PRACTICE")


@pytest.fixture(scope="session")
def builtin_flight():
    """Path of the practice flight that the package ships."""
    return Path(str(files("edl_filter") / "data" / "practice_06.h5"))


def _reconstructed(name, *changes):
    from edl_filter.mission import Mission
    from edl_filter.pipeline.reconstruct import reconstruct

    return reconstruct(Mission.load(f"builtin:{name}", changes))


@pytest.fixture(scope="session")
def spirit():
    """Spirit, reconstructed."""
    return _reconstructed("mer_a", "telemetry.path=builtin:mer_a")


@pytest.fixture(scope="session")
def opportunity():
    """Opportunity, reconstructed."""
    return _reconstructed("mer_b", "telemetry.path=builtin:mer_b")


@pytest.fixture(scope="session")
def practice_06():
    """The flight that the package ships, reconstructed."""
    return _reconstructed("practice_mer")


@pytest.fixture(scope="module")
def browser():
    """Headless Chromium, the one that is installed: playwright's own would be a download of 150 MB."""
    from playwright.sync_api import sync_playwright

    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if path is None:
        pytest.skip("no chromium, chromium-browser or google-chrome is on the path")
    with sync_playwright() as playwright:
        opened = playwright.chromium.launch(executable_path=path, args=["--no-sandbox"])
        yield opened
        opened.close()
