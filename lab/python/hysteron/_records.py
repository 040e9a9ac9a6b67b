"""Recordings: of arrays, or read from files."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Any, Iterable, Literal, Mapping, Union

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._arrays import of_bytes, to_bytes
from ._files import PathLike
from ._native import HysteronError


@dataclass(eq=False)
class Record:
    """One recording: what was commanded and what the sensor read, sample by sample."""

    #: What it is called.
    name: str
    #: Samples per second.
    sample_rate_hz: float
    #: Drive, V; held from each sample to the next.
    drive_v: ArrayLike
    #: Reading of the sensor, um, at the instant at which the drive of the same number begins to act.
    displacement_um: ArrayLike
    #: External force, N, where it was measured.
    force_n: ArrayLike | None = None
    #: Further signals for own effects, by the name that those call them by (``{"temperature_c": ...}``).
    auxiliary: Mapping[str, ArrayLike] = field(default_factory=dict)
    #: "identify" is fitted, "validate" only judges, "noise" is at rest and shows the noise,
    #: "test" takes part in nothing.
    role: Literal["identify", "validate", "noise", "test"] = "identify"
    #: State at the first sample: "virgin" (all states zero), "settled" (at rest at the first drive
    #: after a longer history) or "unknown".
    initial_state: Literal["virgin", "settled", "unknown"] = "unknown"
    #: First sample that counts, and the one behind the last; all without it. What lies before
    #: still drives the model.
    window: tuple[int, int] | None = None
    #: Samples inside the window that do not count, first and behind the last of each stretch:
    #: no reading of the displacement, or another part of a tape.
    left_out: list[tuple[int, int]] = field(default_factory=list)
    #: Steady-state periods: first sample, samples of a period, whole periods.
    periods: tuple[int, int, int] | None = None
    #: Name of the record with the same drive.
    repeat_of: str | None = None
    #: "fit" estimates a constant of the sensor for this record, "zero" does not;
    #: by itself "zero" for a virgin state.
    offset: Literal["fit", "zero"] | None = None

    def _parts(self) -> dict[str, Any]:
        def signal(what: str) -> bytes:
            return to_bytes(getattr(self, what), f"{self.name}: {what}")

        force = None if self.force_n is None else signal("force_n")
        auxiliary = {name: to_bytes(values, f"{self.name}: {name}") for name, values in self.auxiliary.items()}
        signals = {"drive_v": signal("drive_v"), "displacement_um": signal("displacement_um"), "force_n": force}
        return {**vars(self), **signals, "auxiliary": auxiliary}

    @classmethod
    def _of(cls, parts: dict[str, Any]) -> Record:
        signals = {key: of_bytes(parts[key]) for key in ("drive_v", "displacement_um", "force_n") if parts[key] is not None}
        auxiliary = {name: of_bytes(values) for name, values in parts["auxiliary"].items()}
        return cls(**{**parts, **signals, "auxiliary": auxiliary})


class Dataset:
    """Records of one actuator, with the limits of its drive (those of the records where nothing is said).

    Bandwidth and resolution of the sensor are those of its data sheet, where there is one.
    """

    def __init__(
        self, records: Iterable[Record], *, name: str = "recordings", drive_min_v: float | None = None, drive_max_v: float | None = None,
        sensor_bandwidth_hz: float | None = None, sensor_lsb_um: float | None = None,
    ) -> None:
        parts = [record._parts() for record in records]
        drives = [of_bytes(record["drive_v"]) for record in parts if record["drive_v"]]
        if not drives:
            raise HysteronError("records: there are none with samples; expected at least one")
        low = min(float(np.min(drive)) for drive in drives) if drive_min_v is None else float(drive_min_v)
        high = max(float(np.max(drive)) for drive in drives) if drive_max_v is None else float(drive_max_v)
        self._native = _native.Dataset.from_records(name, (low, high), sensor_bandwidth_hz, sensor_lsb_um, parts)

    @classmethod
    def load(
        cls, path: PathLike, *, columns: Mapping[str, int | str] | None = None, units: Mapping[str, str] | None = None,
        auxiliary: Mapping[str, int | str] | None = None, sample_rate_hz: float | None = None, skip_rows: int | None = None,
        timing: str | None = None, intersample: str | None = None,
    ) -> Dataset:
        """Reads a folder with ``dataset.toml``, a manifest, or one file (CSV, MATLAB, HDF5, NPY, NPZ, TDMS, Parquet, Feather, XLSX, WAV).

        ``columns`` says which column is what, by number from 1 or by name: ``{"t": 1, "u": "drive", "y": 2}``. ``units`` says in what they
        are, or how sensitive the sensor is: ``{"u": "mV", "y": "5um/V"}``. ``auxiliary`` names columns of further signals for own effects:
        ``{"temperature_c": 4}``. ``intersample`` says what the drive does between samples: ``hold``, ``linear`` or
        ``band_limited``. What is not said is recognised, and ``notes`` says how.
        """
        dataset = cls.__new__(cls)
        said = (dict(columns or {}), dict(units or {}), dict(auxiliary or {}))
        dataset._native = _native.Dataset.load(os.fspath(path), *said, sample_rate_hz, skip_rows, timing, intersample)
        return dataset

    @property
    def name(self) -> str:
        """Its name."""
        return self._native.name()

    @property
    def drive_limits_v(self) -> tuple[float, float]:
        """Least and greatest drive of the actuator, V."""
        return self._native.drive_limits_v()

    @property
    def sensor_bandwidth_hz(self) -> float | None:
        """Bandwidth of the sensor, where a data sheet gave one."""
        return self._native.sensor_bandwidth_hz()

    @property
    def sensor_lsb_um(self) -> float | None:
        """Resolution of the sensor, where a data sheet gave one."""
        return self._native.sensor_lsb_um()

    @property
    def notes(self) -> list[str]:
        """What was assumed when it was read."""
        return self._native.notes()

    @property
    def records(self) -> list[Record]:
        """Its records; ``Dataset`` makes the same data set of them."""
        return [Record._of(parts) for parts in self._native.records()]

    def _index(self, record: str | int) -> int:
        names = self._native.record_names()
        if isinstance(record, str):
            if record not in names:
                raise HysteronError(f"record `{record}`: expected one of {', '.join(names)}")
            return names.index(record)
        if not 0 <= record < len(names):
            raise HysteronError(f"record {record}: expected 0 to {len(names) - 1}")
        return record

    def __repr__(self) -> str:
        low, high = self.drive_limits_v
        return f"Dataset({self.name!r}, {len(self._native.record_names())} records, {low:g} to {high:g} V)"


load = Dataset.load

Records = Union[Dataset, Iterable[Record]]


def dataset_of(records: Records) -> Dataset:
    """Records by themselves are a data set whose limits are theirs."""
    return records if isinstance(records, Dataset) else Dataset(records)
