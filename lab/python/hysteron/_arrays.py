"""Arrays as the native half takes them: the bytes of 64-bit floats."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ._native import HysteronError


def to_bytes(values: ArrayLike, what: str) -> bytes:
    """One dimension of real numbers; ``what`` is how messages call it."""
    try:
        array = np.asarray(values)
        if np.iscomplexobj(array):
            raise ValueError("complex numbers")
        array = array.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise HysteronError(f"{what}: {error}; expected real numbers") from None
    if array.ndim != 1:
        raise HysteronError(f"{what}: has the shape {array.shape}; expected one dimension")
    return np.ascontiguousarray(array).tobytes()


def of_bytes(values: bytes) -> NDArray[np.float64]:
    """An array that may be written to."""
    return np.frombuffer(values, dtype=np.float64).copy()
