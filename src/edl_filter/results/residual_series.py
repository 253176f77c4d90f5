"""Residuals of a diagnosis against time, as ``residuals.nc`` has them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from edl_filter.errors import InputError
from edl_filter.results.files import RESIDUALS
from edl_filter.results.hdf5 import read_groups
from edl_filter.types import Array

if TYPE_CHECKING:
    from xarray import Dataset


@dataclass(frozen=True, eq=False)
class ResidualSeries:
    """Residuals against time, the contents of ``residuals.nc``; NaN where a channel was not compared.

    Attributes
    ----------
    time : (N,) array
        s since the epoch.
    channels, units : tuple of str
        Names and units of the C channels.
    residual, sigma : (C, N) arrays
        Measured minus predicted, and its stated 1 sigma, in the channel's unit.
    normalised : (C, N) array
        Residual over sigma.
    """

    time: Array
    channels: tuple[str, ...]
    units: tuple[str, ...]
    residual: Array
    sigma: Array
    normalised: Array

    @classmethod
    def from_dataset(cls, dataset: Dataset) -> ResidualSeries:
        """Residuals from an xarray Dataset with the variables of ``residuals.nc``."""
        return cls._from_arrays({str(name): dataset[name].values for name in dataset.variables})

    @classmethod
    def from_file(cls, path: Path) -> ResidualSeries:
        """Residuals from ``residuals.nc``.

        Raises
        ------
        InputError
            The file does not exist or cannot be read.
        """
        if not path.is_file():
            raise InputError(f"{path}: found no {RESIDUALS}; diagnose the result again, which writes it.")
        try:
            variables = read_groups(path)["/"].variables
            return cls._from_arrays({name: variable.values for name, variable in variables.items()})
        except (OSError, KeyError) as error:
            raise InputError(f"{path}: {RESIDUALS} cannot be read ({error!r}); diagnose the result again.") from None

    @classmethod
    def _from_arrays(cls, arrays: Mapping[str, Any]) -> ResidualSeries:
        channels, units = (tuple(map(str, arrays[name])) for name in ("channel", "unit"))
        time, residual, sigma, normalised = (
            np.asarray(arrays[name], float) for name in ("time", "residual", "sigma", "normalised")
        )
        return cls(time, channels, units, residual, sigma, normalised)

    def index(self, channel: str) -> int:
        """Index of a channel.

        Raises
        ------
        InputError
            There is no such channel.
        """
        if channel not in self.channels:
            raise InputError(f"residual: found {channel!r}; accepted: {', '.join(self.channels)}.")
        return self.channels.index(channel)
