"""Windows of a flight: the parts in which coefficients are averaged, and their limits."""

from dataclasses import replace

import numpy as np
import pytest
from model_flights import DATABASE, flight

from edl_filter.errors import InputError
from edl_filter.postflight.derive import derive
from edl_filter.postflight.windows import crossing, detect_deceleration, useful_start


def test_domain_and_windows():
    result = derive(flight())
    regimes = result.regimes
    assert 5 < result.domain.start < result.domain.useful < 80
    assert regimes.identified_by["second"] == "database"
    speed = np.interp([regimes.second.start, regimes.second.end], flight().time, flight().speed)
    assert 3200 < speed[1] < speed[0] < 4000
    starts = [w.start for w in result.windows]
    assert starts == sorted(starts) and result.windows[-1].end <= 240.0
    knudsen = np.interp(regimes.continuum, result.time, np.nan_to_num(result.flight.atmosphere.knudsen))
    assert knudsen == pytest.approx(regimes.continuum_limit, rel=1e-3) and regimes.continuum_limit == 1e-3
    thin = replace(DATABASE, continuum_limit=1e-9)
    assert derive(replace(flight(), database=thin)).regimes.continuum is None


def test_crossing_threshold_and_useful_start():
    t = np.arange(10.0)
    assert crossing(t, 10 - t, 4.5) == pytest.approx(5.5) and np.isnan(crossing(t, 10 - t, 30.0))
    noise = np.array([9, 1, 9, 1, 1, 1, 0.5, 9.0, 9, 9])
    assert useful_start(t, noise, np.full(10, 6.0)) == 3.0 and np.isnan(useful_start(t, noise, np.full(10, 0.3)))
    with pytest.raises(InputError, match="never rises"):
        detect_deceleration(t, np.zeros(10), np.ones(10))
