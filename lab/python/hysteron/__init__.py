"""What the model of a piezoelectric actuator misses on recordings, the better model, and the servo made from it.

Records go in as NumPy arrays, or are read from files; results come out as arrays, dictionaries, and pages that a notebook shows.
Drive is in V, displacement in um, force in N, time in s. ``displacement_um[k]`` is sampled when ``drive_v[k]`` begins to act.
"""

from ._model import Model, Parameter
from ._native import HysteronError, __version__
from ._records import Dataset, Record, load
from ._results import Explanation, Fit, Loop, Servo
from ._survey import Survey, survey
from ._work import add, compare, design, diagnose, explain, identify, track

__all__ = [
    "Dataset", "Explanation", "Fit", "HysteronError", "Loop", "Model", "Parameter", "Record", "Servo", "Survey",
    "add", "compare", "design", "diagnose", "explain", "identify", "load", "survey", "track", "__version__",
]
