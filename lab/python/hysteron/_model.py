"""Models: chains of physical effects with values."""

from __future__ import annotations

import os
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Literal, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _native
from ._arrays import of_bytes, to_bytes
from ._files import PathLike, write_whole
from ._native import HysteronError
from ._records import Dataset


@dataclass(frozen=True)
class Parameter:
    """A value with its standard deviation, where the data gave one."""

    effect: str
    name: str
    value: float
    std: float | None
    unit: str


class Model:
    """A chain of physical effects with values."""

    def __init__(self, native: _native.Model) -> None:
        self._native = native

    @classmethod
    def load(cls, path: PathLike) -> Model:
        """Reads a model that was saved, here or by the program's ``--out``."""
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise HysteronError(f"{os.fspath(path)}: cannot be read: {error}; expected a model written by Hysteron") from None
        return cls(_native.Model.from_toml(text, os.fspath(path)))

    def save(self, path: PathLike) -> None:
        """Writes the file that the program's ``--out`` writes, whole or not at all."""
        write_whole(path, self.to_toml())

    def to_toml(self) -> str:
        """The text of its file."""
        return self._native.to_toml(datetime.now(timezone.utc).date().isoformat())

    def export(
        self, path: PathLike, language: Literal["matlab", "python", "c", "state-space"], sample_rate_hz: float | None = None, *,
        initial_state: Literal["virgin", "settled"] | None = None,
    ) -> None:
        """Writes a function that simulates the model elsewhere; it is called as the file is. ``state-space`` is the linear part with uncertainty, as JSON.

        Rate and beginning are those of the model's records where nothing else is said.
        """
        rate = None if sample_rate_hz is None else float(sample_rate_hz)
        write_whole(path, self._native.export(language, rate, Path(path).stem, initial_state))

    @property
    def effects(self) -> list[str]:
        """Effects in the order of the chain."""
        return self._native.effects()

    @property
    def parameters(self) -> list[Parameter]:
        """All values."""
        return [Parameter(*parts) for parts in self._native.parameters()]

    @property
    def drive_limits_v(self) -> tuple[float, float]:
        """Least and greatest drive for which it holds, V."""
        return self._native.drive_limits_v()

    def simulate(
        self, drive_v: ArrayLike, sample_rate_hz: float, *, force_n: ArrayLike | None = None,
        auxiliary: Mapping[str, ArrayLike] | None = None, initial_state: Literal["virgin", "settled"] | None = None,
    ) -> NDArray[np.float64]:
        """What the sensor would read under a drive, um: as the records of the model begin, or from rest at the lower limit ("virgin") or at the first drive ("settled").

        The drive acts and runs between samples as that of the records did. Rounding by the sensor is left out.
        ``auxiliary`` holds the signals that own effects of the model take part of.
        """
        force = None if force_n is None else to_bytes(force_n, "force_n")
        further = {name: to_bytes(values, name) for name, values in (auxiliary or {}).items()}
        return of_bytes(self._native.simulate(to_bytes(drive_v, "drive_v"), force, further, float(sample_rate_hz), initial_state))

    def residual(self, dataset: Dataset, record: str | int) -> NDArray[np.float64]:
        """Measured less modelled inside the window of a record, um; readings beyond the sensor's range count in no figure."""
        return of_bytes(self._native.residual(dataset._native, dataset._index(record)))

    def __repr__(self) -> str:
        return f"Model({', '.join(self.effects)})"
