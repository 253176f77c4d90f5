"""What a user could reach for today, on the same flights: `make study-comparators`.

Two methods that are in use regress the residual coefficients, flight minus database, on a library of regressors, each
of which stands for one effect of the catalogue (`regressors.regressors`):

`stepwise`
    forward selection by partial F, as SIDPAC's ``swr`` does it (Klein & Morelli, Aircraft System Identification, 2006,
    section 5.4): F-in and F-out 20, and at least half a percent more of R².
`sindy`
    sequentially thresholded least squares (Brunton, Proctor & Kutz, PNAS 113 (2016) 3932), `pysindy.STLSQ` as it comes,
    on a standardised library. Needs ``pip install 'edl-filter[study]'``.

Both are given more than their usual users would give them: all six coefficients at once, with one parameter for all of
them; the database through the flight's own smoothing; forms, edges and onsets of the catalogue; each sample over its
sigma, in which the preflight density's, the angles' and the sensors' are (of noise alone, all but the angles, and all,
it is with all that they name the practice flights best); and nothing is named where the residuals are within that.

What they cannot see. They look at forces and moments along the reconstructed path and nowhere else. An effect on
navigation alone leaves nothing there: `gravity_oblateness` has no regressor, gyro bias and scale have one by Euler's
equations only, where they are far below the noise, and of `attitude_frame` there is the air's direction. What landing,
rest, altimeter and second IMU say is not used, and a part of the effect is gone into the path and the sensor errors
that the reconstruction estimates. They know no plausible size. They take residuals that are coloured by air and
smoothing for white ones, so F is far too large: wherever they begin, they name something, and what is in no catalogue
gets the nearest names. Beginnings and edges are known to a grid.

Run: ``python benchmarks/studies/comparators.py [FOLDER]``, the practice flights' (default: ``$EDL_FILTER_PRACTICE``)
"""

import argparse
import json
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from regressors import Regression, regression_of

from edl_filter import Mission, reconstruct
from edl_filter.reconstruction import Reconstruction

Array = NDArray[np.float64]

#: A regressor enters, and stays, with this partial F; it enters with at least this much more of R².
F_IN, F_OUT, LEAST_R2 = 20.0, 20.0, 0.005
#: pysindy's own defaults: share of the residuals' norm below which a term goes, and ridge.
THRESHOLD, RIDGE = 0.1, 0.05


def standardised(r: Regression) -> Regression:
    """Residual and columns of unit length, without columns of nothing."""
    size = np.linalg.norm(r.library, axis=0)
    some = size > 1e-12 * size.max()
    names = tuple(name for name, there in zip(r.names, some, strict=True) if there)
    return Regression(r.residual / np.linalg.norm(r.residual), r.library[:, some] / size[some], names)


def within_sigma(r: Regression) -> bool:
    """Whether the residuals as a whole are no larger than their sigma: then nobody asks further."""
    return bool(r.residual @ r.residual <= len(r.residual))


def forward(r: Regression) -> list[str]:
    """Names by forward selection on partial F with backward elimination, in the order of their entry."""
    if within_sigma(r):
        return []
    r = standardised(r)
    return list(dict.fromkeys(r.names[k] for k in _selected(r.residual, r.library)))


def _selected(y: Array, x: Array) -> list[int]:
    """Columns of unit length that explain `y`, of unit length, in the order of their entry."""
    inside: list[int] = []
    dropped: set[int] = set()
    while True:
        basis = np.linalg.qr(x[:, inside])[0]
        error, rest = y - basis @ (basis.T @ y), x - basis @ (basis.T @ x)
        size = np.linalg.norm(rest, axis=0)
        new = size > 1e-6  # a combination of what is inside adds nothing
        new[[*inside, *dropped]] = False
        gain = np.where(new, (rest.T @ error / np.where(new, size, 1.0)) ** 2, 0.0)
        best, freedom = int(np.argmax(gain)), len(y) - len(inside) - 1
        if gain[best] < LEAST_R2 or gain[best] * freedom < F_IN * (error @ error - gain[best]):
            return inside
        inside.append(best)
        while (weakest := _weakest(x[:, inside], y)) is not None:
            dropped.add(inside.pop(weakest))


def _weakest(x: Array, y: Array) -> int | None:
    """The column with the least partial F, if that is below `F_OUT`."""
    inverse = np.linalg.inv(x.T @ x)
    value = inverse @ (x.T @ y)
    error = y - x @ value
    partial = value**2 / np.diag(inverse) * (len(y) - x.shape[1]) / max(float(error @ error), 1e-300)
    k = int(np.argmin(partial))
    return k if partial[k] < F_OUT else None


def thresholded(r: Regression) -> list[str]:
    """Names by pysindy's STLSQ, those first that make up most of the residual."""
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


def practised(path: Path) -> Regression:
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
    right = dict.fromkeys(METHODS, 0)
    for name, answer in answers.items():
        r, truth = practised(folder / f"{name}.h5"), answer["effects"]
        rms = np.sqrt(np.mean(r.residual**2))
        print(f"{name}  truth: {', '.join(truth) or 'clean'}  (rms of the residuals: {rms:.2f} sigma)")
        for method, names_of in METHODS.items():
            names = names_of(r)
            right[method] += identified(names, truth)
            mark = "+" if identified(names, truth) else "-"
            print(f"  {mark} {method:9s} {', '.join(names) or 'nothing'}")
    for method, count in right.items():
        print(f"{method}: {count} of {len(answers)} with a true name first, or rightly none")


if __name__ == "__main__":
    main()
