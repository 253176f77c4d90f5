"""The package beside dynamax, Stone Soup, pyins, pymap3d and astropy: the same problem, and the answers compared.

A peer that is not installed is named as such (``pip install 'edl-filter[bench]'``).

Run: ``python benchmarks/bench_peers.py``
"""

from __future__ import annotations

import time

import numpy as np
import peer_geodesy
import peer_problem
from measuring import Row, Section, Times, at_least, installed, interleaved, missing, run

from edl_filter.estimation.parallel import one_blas_thread
from edl_filter.navigation.ukf import ErrorStateUKF

EPOCHS = 400
TOLERANCE = 5e-3  # sigmas: the peers' reference is fixed and ours moves, second order in the attitude error
FLIGHT = 60.0  # s, of 100 Hz
PYINS_TOLERANCE = 0.1  # sigmas: J4 of the Earth's gravity
GOALS = {"dynamax": at_least(10.0), "pyins": at_least(100.0)}
METRES = {"pymap3d": 1e-3, "astropy": 1e-6}


def same_problem() -> list[Row]:
    """dynamax, Stone Soup and filterpy on `peer_problem`."""
    given = peer_problem.problem(EPOCHS)
    means, sigmas = peer_problem.ours(given)
    functions = {
        "ours": lambda: peer_problem.ours(given),
        "filterpy": lambda: peer_problem.ours(given, ErrorStateUKF),
    }
    rows, first = [], {}
    for name, modules, distribution in (
        ("dynamax", ("dynamax", "jax"), "dynamax"),
        ("Stone Soup", ("stonesoup",), "stonesoup"),
    ):
        if not installed(*modules):
            rows.append(missing(f"UKF of {name}, an epoch", "compiled UKF", distribution, GOALS.get(name)))
            continue
        if name == "dynamax":
            import peer_dynamax as peer
        else:
            import peer_stonesoup as peer
        functions[name] = peer.prepared(given)
        begin = time.process_time()
        theirs = functions[name]()
        first[name] = time.process_time() - begin
        difference = max(np.max(np.abs(theirs[0] - means) / sigmas), np.max(np.abs(theirs[1] / sigmas - 1.0)))
        assert difference < TOLERANCE, (name, difference)
        rows.append((name, f"equal to {difference:.0e} sigma (asserted: {TOLERANCE:g})"))
    times = interleaved(functions, rounds=7)
    out: list[Row] = [times.row("UKF on filterpy with one kernel, an epoch", "compiled UKF", "filterpy", "ours")]
    for row in rows:
        if isinstance(row, Row):
            out.append(row)
            continue
        name, agreement = row
        out.append(times.row(f"UKF of {name}, an epoch", "compiled UKF", name, "ours", GOALS.get(name), agreement))
        if name == "dynamax":
            ratio = first[name] / times.least("ours")
            out.append(
                Row(
                    f"UKF of dynamax, first call with compilation, {EPOCHS} epochs",
                    "compiled UKF, from its cache",
                    ratio,
                )
            )
    return out


def pyins() -> list[Row]:
    """Strapdown integration and filter of pyins."""
    if not installed("pyins"):
        return [missing("pyins: `run_feedback_filter`, time a sample", "UKF", "python-ins", GOALS["pyins"])]
    import peer_pyins as peer

    given = peer.flight(FLIGHT)
    theirs, ours = peer.integrated(given)
    last, state = peer.inertial_states(theirs().iloc[-1:])[0], ours()
    distance, speed = np.linalg.norm(last[:3] - state[:3]), np.linalg.norm(last[3:6] - state[3:6])
    turn = np.linalg.norm(last[6:] * np.sign(last[9] * state[9]) - state[6:]) * 2.0
    assert distance < 0.2 and speed < 5e-3 and turn < 1e-8, (distance, speed, turn)
    agreement = f"after {FLIGHT:g} s {distance:.2f} m (J4) and {turn:.0e} rad apart"
    bare_theirs, bare_ours = peer.bare_integration(given)
    times = interleaved({"t": theirs, "o": ours, "bare t": bare_theirs, "bare o": bare_ours}, rounds=5)
    rows = [
        times.row(
            "pyins: increments and strapdown integration of one state",
            "samples with noise and integration",
            "t",
            "o",
            None,
            agreement,
        ),
        times.row(
            "pyins: integration alone of one state",
            f"integration alone of {peer.our_strapdown.LANES} states",
            "bare t",
            "bare o",
        ),
    ]
    flight = peer.measured(given)
    functions = {method: peer.our_filter(*flight, method) for method in ("ukf", "ekf")}
    results = {method: function() for method, function in functions.items()}
    for step, goal in ((0.1, GOALS["pyins"]), (1.0, None)):
        function = peer.their_filter(*flight, step)
        seconds: dict[str, list[float]] = {"pyins": [], "ukf": [], "ekf": []}
        for _ in range(2):
            part = interleaved(functions, rounds=3)
            for method in functions:
                seconds[method].append(part.least(method))
            begin = time.process_time()
            result = function()
            seconds["pyins"].append(time.process_time() - begin)
        times = Times(seconds)
        for method in functions:
            difference = peer.difference_in_sigmas(result, results[method])
            assert difference < PYINS_TOLERANCE, (method, difference)
            rows.append(
                times.row(
                    f"pyins: `run_feedback_filter`, steps of {step:g} s, time a sample",
                    f"{method.upper()} with the same fixes",
                    "pyins",
                    method,
                    goal if method == "ukf" else None,
                    f"last states equal to {difference:.2f} sigma (asserted: {PYINS_TOLERANCE:g})",
                )
            )
    return rows


def geodesy() -> list[Row]:
    """pymap3d and astropy."""
    points = peer_geodesy.positions()
    functions, agreements = {"ours": peer_geodesy.ours(points)}, {}
    reference = functions["ours"]()
    what = "geodetic coordinates of 100 000 points"
    for name, tolerance in METRES.items():
        if not installed(name):
            continue
        functions[name] = getattr(peer_geodesy, name)(points)
        difference = peer_geodesy.largest_difference(functions[name](), reference)
        assert difference < tolerance, (name, difference)
        agreements[name] = f"equal to {difference:.0e} m (asserted: {tolerance:g})"
    times = interleaved(functions, rounds=7)
    return [
        times.row(f"{name}: {what}", "the package", name, "ours", None, agreements[name])
        if name in agreements
        else missing(f"{name}: {what}", "the package", name)
        for name in METRES
    ]


def measure() -> list[Section]:
    """All sections."""
    with one_blas_thread():
        filters, navigation = same_problem(), pyins()
    text = f"""
dynamax and Stone Soup: {EPOCHS} epochs of one IMU sample and one position, 15 states, the same sigma points, process
noise and prior. Their vector is the error about a fixed reference. This package moves its reference to the estimate;
the two differ in second order of the attitude error. dynamax runs in one jitted scan with float64 on the CPU. Stone
Soup evaluates all sigma points in one numpy call.

pyins: {FLIGHT:g} s of 100 Hz over the Earth, 15 states, a position fix each second. pyins has the ellipsoid's normal
gravity, this package a point mass and J2, so that the answers differ by J4. The result of pyins has the state after
each sample, that of this package the state and covariance at each fix. BLAS has one thread. The samples of this package
contain more than increments: sculling and coning by a spline, and the noise of motion that the samples do not resolve.
These take most of the time of the samples.
"""
    return [Section("Comparison with other packages", text, [*filters, *navigation, *geodesy()])]


if __name__ == "__main__":
    run(measure)
