"""What the work comes to: figures, models, pages, servos."""

from __future__ import annotations

import html
import json
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from . import _native
from ._files import PathLike, write_whole
from ._model import Model
from ._records import Dataset


class Fit:
    """A model with its figures on a data set; a notebook shows its page."""

    def __init__(self, native: _native.Outcome, dataset: Dataset) -> None:
        self._native = native
        #: The data set.
        self.dataset = dataset
        #: Every figure, as the program's ``--json`` writes them.
        self.figures: dict[str, Any] = json.loads(native.figures())
        #: The model.
        self.model = Model(native.model())

    @property
    def noise_floor_um(self) -> float | None:
        """What the sensor's noise leaves, um RMS; None where the data do not show it."""
        floor: float | None = self.figures["noise_floor_um"]
        return floor

    def residual(self, record: str | int) -> NDArray[np.float64]:
        """Measured less modelled inside the window of a record, um; readings beyond the sensor's range count in no figure."""
        return self.model.residual(self.dataset, record)

    def html(self) -> str:
        """The page that the program's ``--report`` writes: one file that opens without a network."""
        return self._native.html()

    def save_report(self, path: PathLike) -> None:
        """Writes the page, whole or not at all."""
        write_whole(path, self.html())

    def _repr_html_(self) -> str:
        # A frame of its own: the page's style and scripts stay inside it.
        return (
            f'<iframe srcdoc="{html.escape(self.html())}" sandbox="allow-scripts allow-downloads" title="Hysteron" '
            'style="width: 100%; height: 48rem; border: 1px solid #8884; border-radius: 4px; background: #fff"></iframe>'
        )

    @property
    def replays(self) -> list[dict[str, Any]]:
        """The model driven from the first sample of each file to its last: ``rms_um``, ``max_um``, ``judged_um`` and, where it is worse, ``drift`` with its cause."""
        found: list[dict[str, Any]] = self.figures["replays"]
        return found

    def __repr__(self) -> str:
        errors = ", ".join(f"{record['file']} {1e3 * record['rms_um']:.3g} nm" for record in self.figures["records"])
        return f"{self.model!r}: {errors}"


class Explanation(Fit):
    """What a model misses: a verdict, the names, the evidence; and the model with them."""

    @property
    def diagnosis(self) -> dict[str, Any]:
        """All of it, as the program's ``diagnose --json`` writes it."""
        found: dict[str, Any] = self.figures["diagnosis"]
        return found

    @property
    def verdict(self) -> Literal["at_floor", "named", "ambiguous", "unexplained", "undecidable"]:
        """One of five words."""
        word: Literal["at_floor", "named", "ambiguous", "unexplained", "undecidable"] = self.diagnosis["verdict"]
        return word

    @property
    def named(self) -> list[str]:
        """The missing effects; with "ambiguous" all that the data cannot distinguish."""
        effects: list[str] = self.diagnosis["named"]
        return effects

    @property
    def sentence(self) -> str:
        """The verdict for a person."""
        sentence: str = self.diagnosis["sentence"]
        return sentence

    @property
    def next_drive(self) -> str | None:
        """Where the data cannot decide: the drive that would, as CSV."""
        return self._native.next_drive()

    def __repr__(self) -> str:
        return f"{self.verdict}: {self.sentence}"


class Loop:
    """A servo in a loop of your own: the integers that the board runs, a tick at a time.

    It begins on a stage that was cycled over its range and rests at its lowest drive; readings count from there.
    """

    def __init__(self, servo: Servo) -> None:
        self._native = _native.Loop(servo.toml)

    def tick(self, reading_um: float, reference_um: float) -> float:
        """The drive, V, that is to act in the next period. ``reference_um`` is what the stage shall follow eight ticks later."""
        return self._native.tick(reading_um, reference_um)


@dataclass(frozen=True)
class Servo:
    """A servo for a model."""

    #: The file that the program's ``design --out`` writes.
    toml: str
    #: Every figure of the design.
    figures: dict[str, Any]

    @property
    def explanation(self) -> list[str]:
        """Why this one, in sentences."""
        sentences: list[str] = self.figures["explanation"]
        return sentences

    def save(self, path: PathLike) -> None:
        """Writes the servo's file, for ``hysteron check`` and ``hysteron track``, whole or not at all."""
        write_whole(path, self.toml)

    def loop(self) -> Loop:
        """The servo at its first tick."""
        return Loop(self)
