"""Methods that are in use today, on the same flights: `make study-comparators`.

Two methods regress the residual coefficients, flight minus database, on a library of regressors, each of which stands
for one effect of the catalogue (`regressors.regressors`):

`stepwise`
    forward selection by partial F, as SIDPAC's ``swr`` does it (Klein & Morelli, Aircraft System Identification, 2006,
    section 5.4): F-in and F-out 20, and at least half a percent more of R².
`sindy`
    sequentially thresholded least squares (Brunton, Proctor & Kutz, PNAS 113 (2016) 3932), `pysindy.STLSQ` with its
    default settings, on a standardised library. Needs ``pip install 'edl-filter[study]'``.

Both have more information than in their usual use: all six coefficients at once, with one parameter for all of them;
the database with the flight's own smoothing; forms, edges and onsets of the catalogue; each sample over its sigma,
which contains the uncertainties of the preflight density, the angles and the sensors (of noise alone, all but the
angles, and all, they name the practice flights best with all); and nothing is named where the residuals are within
that.

Their limits. They use forces and moments along the reconstructed path alone. An effect on navigation alone leaves
nothing there: `gravity_oblateness` has no regressor, gyro bias and scale have one by Euler's equations only, where they
are far below the noise, and of `attitude_frame` there is the air's direction. Landing, rest, altimeter and second IMU
are not used, and the path and the sensor errors that the reconstruction estimates have absorbed a part of the effect.
They use no plausible size. They treat residuals that are coloured by air and smoothing as white ones, so F is far too
large: wherever residuals exceed their sigma they name something, and an effect outside the catalogue gets the nearest
names. Onsets and edges are known to a grid.

Run: ``python benchmarks/studies/comparators.py [FOLDER]``, the practice flights' (default: ``$EDL_FILTER_PRACTICE``)
"""

import argparse
import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from regressors import Regression, regression_of

from edl_filter import Mission, reconstruct
from edl_filter.pipeline.reconstruct import Reconstruction
from edl_filter.types import Array

#: A regressor enters, and stays, with this partial F; it enters with at least this much more of R².
F_IN, F_OUT, LEAST_R2 = 20.0, 20.0, 0.005
#: pysindy's own defaults: share of the residuals' norm below which a term goes, and ridge.
THRESHOLD, RIDGE = 0.1, 0.05


def standardised(r: Regression) -> Regression:
    """Residual and columns of unit length, without columns that are zero."""
    size = np.linalg.norm(r.library, axis=0)
    nonzero = size > 1e-12 * size.max()
    names = tuple(name for name, used in zip(r.names, nonzero, strict=True) if used)
    return Regression(r.residual / np.linalg.norm(r.residual), r.library[:, nonzero] / size[nonzero], names)


def within_sigma(r: Regression) -> bool:
    """Whether the residuals as a whole are no larger than their sigma: then no method names an effect."""
    return bool(r.residual @ r.residual <= len(r.residual))


def forward(r: Regression) -> list[str]:
    """Names by forward selection on partial F with backward elimination, in the order of their entry."""
    if within_sigma(r):
        return []
    r = standardised(r)
    return list(dict.fromkeys(r.names[k] for k in _selected(r.residual, r.library)))


def _selected(y: Array, x: Array) -> list[int]:
    """Columns of unit length that explain `y`, of unit length, in the order of their entry."""
    selected: list[int] = []
    dropped: set[int] = set()
    while True:
        basis = np.linalg.qr(x[:, selected])[0]
        error, remainder = y - basis @ (basis.T @ y), x - basis @ (basis.T @ x)
        size = np.linalg.norm(remainder, axis=0)
        new = size > 1e-6  # a combination of selected columns adds nothing
        new[[*selected, *dropped]] = False
        gain = np.where(new, (remainder.T @ error / np.where(new, size, 1.0)) ** 2, 0.0)
        best, freedom = int(np.argmax(gain)), len(y) - len(selected) - 1
        if gain[best] < LEAST_R2 or gain[best] * freedom < F_IN * (error @ error - gain[best]):
            return selected
        selected.append(best)
        while (weakest := _weakest(x[:, selected], y)) is not None:
            dropped.add(selected.pop(weakest))


def _weakest(x: Array, y: Array) -> int | None:
    """The column with the least partial F, if that is below `F_OUT`."""
    inverse = np.linalg.inv(x.T @ x)
    value = inverse @ (x.T @ y)
    error = y - x @ value
    partial = value**2 / np.diag(inverse) * (len(y) - x.shape[1]) / max(float(error @ error), 1e-300)
    k = int(np.argmin(partial))
    return k if partial[k] < F_OUT else None


def thresholded(r: Regression) -> list[str]:
    """Names by pysindy's STLSQ, in the order of their share of the residual."""
    from pysindy import STLSQ

    if within_sigma(r):
        return []
    r = standardised(r)
    optimizer = STLSQ(threshold=THRESHOLD, alpha=RIDGE)
    optimizer.fit(r.library, r.residual[:, None])
    weight, names = np.ravel(optimizer.coef_), np.array(r.names)
    share = {name: np.linalg.norm(r.library @ np.where(names == name, weight, 0.0)) for name in dict.fromkeys(r.names)}
    return sorted((name for name, size in share.items() if size > 0.0), key=lambda name: -share[name])


def stepwise(flight_result: Reconstruction) -> list[str]:
    """Effects that forward selection names on a reconstructed flight, in the order of importance."""
    return forward(regression_of(flight_result))


def sindy(flight_result: Reconstruction) -> list[str]:
    """Effects that sequentially thresholded least squares names on a reconstructed flight, in the order of importance.

    Raises
    ------
    ImportError
        pysindy is not installed.
    """
    return thresholded(regression_of(flight_result))


#: Practice flights of the Phoenix-like vehicle.
_PHOENIX = ("practice_03", "practice_05")
METHODS = {"stepwise": forward, "sindy": thresholded}


def identified(names: Sequence[str], truth: Sequence[str]) -> bool:
    """Whether the first name is true; on a clean flight, whether there is none."""
    return names[0] in truth if names else not truth


def practice_regression(path: Path) -> Regression:
    """Regression of a practice flight."""
    vehicle = "phoenix" if path.stem in _PHOENIX else "mer"
    return regression_of(reconstruct(Mission.load(f"builtin:practice_{vehicle}", [f"telemetry.path={path}"])))


def main() -> None:
    """Print truth and names of every practice flight."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", default=os.environ.get("EDL_FILTER_PRACTICE"), type=Path)
    folder = parser.parse_args().folder
    if folder is None:
        parser.error("the folder of the practice flights: give it, or set EDL_FILTER_PRACTICE")
    answers = json.loads((folder / "answers.json").read_text())
    correct = dict.fromkeys(METHODS, 0)
    for name, answer in answers.items():
        r, truth = practice_regression(folder / f"{name}.h5"), answer["effects"]
        rms = np.sqrt(np.mean(r.residual**2))
        print(f"{name}  truth: {', '.join(truth) or 'clean'}  (rms of the residuals: {rms:.2f} sigma)")
        for method, names_of in METHODS.items():
            names = names_of(r)
            correct[method] += identified(names, truth)
            mark = "+" if identified(names, truth) else "-"
            print(f"  {mark} {method:9s} {', '.join(names) or 'nothing'}")
    for method, count in correct.items():
        print(f"{method}: {count} of {len(answers)} with a true name first, or rightly none")


if __name__ == "__main__":
    main()
