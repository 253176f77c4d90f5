"""Prediction of one flight with the increments of another: equal to dense conditional densities."""

import numpy as np
import pytest
from cross_prediction import knot_columns, row_gains
from field_flights import ALPHA, PRIOR, Flight
from scipy.stats import multivariate_normal


def evidence(flight, distance):
    whiten, white = flight.white()
    columns = knot_columns(whiten, flight.fields, flight.distance, PRIOR, flight.modes, distance, ALPHA)
    return whiten, columns, white


def unwhitened(flight, whiten, columns):
    """Product of the whitening's inverse and columns: the covariance of the residuals' own rows."""
    rows = whiten(np.eye(flight.count), np.zeros((0, flight.count)))
    return np.linalg.solve(rows, columns)


def test_the_gain_is_that_of_the_dense_conditional_density():
    learned, predicted = Flight(seed=3), Flight(seed=4)
    # what both have flown over, in the first regime
    distance = np.linspace(0.2, 3.0, 8)
    _, first, first_white = evidence(learned, distance)
    whiten, second, second_white = evidence(predicted, distance)
    gains = row_gains(first, first_white, second, second_white)
    prior = predicted.covariance()
    cross = unwhitened(predicted, whiten, second)
    mean = cross @ (first.T @ first_white)
    covariance = prior - cross @ (first.T @ first) @ cross.T
    residuals = predicted.residuals
    for part in (slice(None), slice(0, 41)):  # all rows; the first ones given nothing but the other flight
        densities = [
            multivariate_normal.logpdf(residuals[part], m[part], c[part, part])
            for m, c in ((mean, covariance), (0.0 * mean, prior))
        ]
        assert np.sum(gains[part]) == pytest.approx(densities[0] - densities[1], abs=1e-7)


def test_a_flight_with_the_same_errors_is_predicted_and_one_with_others_is_not():
    learned = Flight(seed=3)
    distance = np.concatenate((np.linspace(0.2, 3.0, 12), learned.distance[-1] - np.linspace(2.0, 0.2, 8)))
    random = np.random.default_rng(0)
    truth = random.multivariate_normal(np.zeros(learned.count), learned.covariance(), method="cholesky")
    noise = random.normal(size=(2, learned.count)) * learned.noise
    gains = {}
    for sign in (1.0, -1.0):
        learned.residuals = truth + noise[0]
        _, first, first_white = evidence(learned, distance)
        learned.residuals = sign * truth + noise[1]
        _, second, second_white = evidence(learned, distance)
        gains[sign] = np.sum(row_gains(first, first_white, second, second_white))
    assert gains[1.0] > 20.0
    assert gains[-1.0] < -100.0


def test_a_flight_without_information_gains_nothing():
    learned, predicted = Flight(seed=3), Flight(seed=4)
    distance = np.linspace(0.2, 3.0, 8)
    _, first, first_white = evidence(learned, distance)
    _, second, second_white = evidence(predicted, distance)
    assert np.all(row_gains(0.0 * first, first_white, second, second_white) == 0.0)


def test_the_gain_of_all_rows_is_the_same_in_both_directions():
    """It is ln p(y1, y2) - ln p(y1) - ln p(y2), a symmetric function of both flights."""
    flights, distance = (Flight(seed=3), Flight(seed=4)), np.linspace(0.2, 3.0, 8)
    (_, first, first_white), (_, second, second_white) = (evidence(flight, distance) for flight in flights)
    forward = row_gains(first, first_white, second, second_white)
    backward = row_gains(second, second_white, first, first_white)
    assert np.sum(forward) == pytest.approx(np.sum(backward), abs=1e-9)
    assert not np.allclose(forward[: len(backward)], backward[: len(forward)])  # its parts are not
