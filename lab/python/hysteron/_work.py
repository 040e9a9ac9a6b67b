"""The pieces of work that the program has as commands.

Effects are named as the program names them, one by one or with commas between; a name that ends in ``.toml`` is a file that defines an effect
of your own. ``progress`` is called with a line of text at every step. What it raises, and Ctrl-C, end the work at its next step. All of it
goes on without Python's lock: threads of one process work side by side.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Callable, Iterable, Union

from . import _native
from ._files import PathLike
from ._model import Model
from ._native import HysteronError
from ._records import Records, dataset_of
from ._results import Explanation, Fit, Servo

Progress = Callable[[str], Any]
Effects = Union[PathLike, Iterable[PathLike]]


def _effects(said: Effects) -> list[str | tuple[str, str]]:
    items = [said] if isinstance(said, (str, os.PathLike)) else list(said)
    names = [name.strip() for item in items for name in os.fspath(item).split(",")]
    return [_own(name) if name.endswith(".toml") else name for name in names if name]


def _own(path: str) -> tuple[str, str]:
    """The definition of an effect of the user's own, and what it is called in messages."""
    try:
        return Path(path).read_text(encoding="utf-8"), path
    except (OSError, UnicodeDecodeError) as error:
        raise HysteronError(f"{path}: cannot be read: {error}; expected the definition of an effect") from None


def explain(records: Records, start: Effects = "gain", *, own: Effects = (), progress: Progress | None = None) -> Explanation:
    """The main job: identifies, compares, diagnoses and adds effects to ``start`` until the noise is reached.

    ``own`` are effects of yours that take part beside those that are known.
    """
    dataset = dataset_of(records)
    return Explanation(_native.explain(dataset._native, _effects(start), _effects(own), progress), dataset)


def identify(records: Records, effects: Effects, *, progress: Progress | None = None) -> Fit:
    """Fits a list of effects."""
    dataset = dataset_of(records)
    return Fit(_native.identify(dataset._native, _effects(effects), progress), dataset)


def compare(model: Model, records: Records) -> Fit:
    """Compares a model as it is with records."""
    dataset = dataset_of(records)
    return Fit(_native.compare(model._native, dataset._native), dataset)


def diagnose(model: Model, records: Records, *, own: Effects = (), progress: Progress | None = None) -> Explanation:
    """Says which physical effect a model misses on records."""
    dataset = dataset_of(records)
    return Explanation(_native.diagnose(model._native, dataset._native, _effects(own), progress), dataset)


def add(effect: PathLike, model: Model, records: Records, *, progress: Progress | None = None) -> Fit:
    """Adds one effect to a model and fits again."""
    dataset, effects = dataset_of(records), _effects(effect)
    if len(effects) != 1:
        raise HysteronError(f"effect: {os.fspath(effect)!r} are {len(effects)}; expected one")
    return Fit(_native.add(effects[0], model._native, dataset._native, progress), dataset)


def design(
    model: Model, records: Records | None = None, *, reference_hz: float = 150.0, sensor_noise_um: float | None = None,
    sensor_bandwidth_hz: float | None = None, sensitivity_peak: float | None = None,
) -> Servo:
    """Designs a servo for references up to ``reference_hz``; with the records behind the model it holds for all that they leave possible.

    The lag of a sensor of ``sensor_bandwidth_hz`` is undone; without it what the model or the data set knows of it.
    Without ``sensitivity_peak`` the loop keeps 1.8, 8 dB and 35 degrees where that costs less than a third of the error.
    """
    native = None if records is None else dataset_of(records)._native
    toml, figures = _native.design(model._native, native, reference_hz, sensor_noise_um, sensor_bandwidth_hz, sensitivity_peak)
    return Servo(toml, json.loads(figures))


def track(
    servo: Servo, plant: Model | Callable[[float], float | tuple[float, float]], reference: str = "sine:10:1:2", *, scheme: str | None = None,
    sensor_noise_um: float | None = None,
) -> dict[str, Any]:
    """Follows a reference with a servo, and gives every figure of the program's ``track --json``.

    ``plant`` is a model, or a function that is called with the drive of each sampling period, V. It gives the reading at the end of the period, um,
    or that and the true position. ``reference`` is written as for the program: ``sine:HZ:UM:OFFSET_UM``, ``step:UM``.
    """
    native = plant._native if isinstance(plant, Model) else plant
    figures: dict[str, Any] = json.loads(_native.track(servo.toml, native, reference, scheme, sensor_noise_um))
    return figures
