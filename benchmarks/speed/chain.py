#!/usr/bin/env python3
"""Times the chain of the example `speed` as it is written with NumPy, Numba and JAX: ten plays, three relaxations, a mode.

    python3 benchmarks/speed/chain.py

Prints `program,samples,seconds`, the quickest of several runs on one core. Needs NumPy, SciPy, Numba and JAX; `chain.m` beside it has
the same for Octave.
"""

import math
import time

import jax
import numpy
from jax import numpy as jnp
from numba import njit
from scipy.signal import lfilter

RATE_HZ = 20_000.0
DRIVE_MAX_V = 70.0
SAMPLES = 1_000_000
RUNS = 5

THRESHOLDS = numpy.array([0.05 * i for i in range(10)])
WEIGHTS_UM = numpy.array([8.4] + [0.23] * 9)
SHARES = numpy.array([0.02, 0.02, 0.02])
TIME_CONSTANTS_S = numpy.array([0.1, 1.0, 10.0])


def mode():
    """Coefficients of a mode of 5000 rad/s and a damping ratio of 0.3 behind a held input."""
    w, d, t = 5000.0, 0.3, 1.0 / RATE_HZ
    a = math.exp(-d * w * t)
    p = w * math.sqrt(1.0 - d * d)
    c, s = math.cos(p * t), math.sin(p * t)
    b1 = 1.0 - a * (c + d * w / p * s)
    b2 = a * a + a * (d * w / p * s - c)
    return b1, b2, -2.0 * a * c, a * a


MODE = mode()
DECAYS = numpy.exp(-1.0 / RATE_HZ / TIME_CONSTANTS_S)


def with_numpy(drive):
    """One loop over the samples for all plays together, filters for the rest."""
    x = drive / DRIVE_MAX_V
    plays = numpy.zeros(len(THRESHOLDS))
    out = numpy.empty(len(x))
    for k, u in enumerate(x):
        plays = numpy.minimum(numpy.maximum(plays, u - THRESHOLDS), u + THRESHOLDS)
        out[k] = WEIGHTS_UM @ plays
    slow = sum(
        s * lfilter([0.0, 1.0 - d], [1.0, -d], out) for s, d in zip(SHARES, DECAYS)
    )
    b1, b2, a1, a2 = MODE
    return lfilter([0.0, b1, b2], [1.0, a1, a2], out + slow)


@njit(cache=False)
def with_numba(drive, thresholds, weights, shares, decays, b1, b2, a1, a2):
    """All in one loop."""
    plays = numpy.zeros(len(thresholds))
    slow = numpy.zeros(len(shares))
    y1 = y2 = u1 = u2 = 0.0
    out = numpy.empty(len(drive))
    for k in range(len(drive)):
        x = drive[k] / DRIVE_MAX_V
        total = 0.0
        for i in range(len(thresholds)):
            play = min(max(plays[i], x - thresholds[i]), x + thresholds[i])
            plays[i] = play
            total += weights[i] * play
        crept = total
        for i in range(len(shares)):
            crept += shares[i] * slow[i]
            slow[i] = decays[i] * slow[i] + (1.0 - decays[i]) * total
        y = b1 * u1 + b2 * u2 - a1 * y1 - a2 * y2
        y2, y1, u2, u1 = y1, y, u1, crept
        out[k] = y
    return out


@jax.jit
def with_jax(drive):
    """All in one scan."""

    def step(state, drive_v):
        plays, slow, (y1, y2, u1, u2) = state
        x = drive_v / DRIVE_MAX_V
        plays = jnp.clip(plays, x - THRESHOLDS, x + THRESHOLDS)
        total = WEIGHTS_UM @ plays
        crept = total + SHARES @ slow
        slow = DECAYS * slow + (1.0 - DECAYS) * total
        b1, b2, a1, a2 = MODE
        y = b1 * u1 + b2 * u2 - a1 * y1 - a2 * y2
        return (plays, slow, (y, y1, crept, u1)), y

    begin = (jnp.zeros(len(THRESHOLDS)), jnp.zeros(len(SHARES)), (0.0,) * 4)
    return jax.lax.scan(step, begin, drive)[1]


def quickest_s(run, drive, runs):
    times = []
    for _ in range(runs):
        begin = time.perf_counter()
        run(drive)
        times.append(time.perf_counter() - begin)
    return min(times)


def main():
    def triangle(period):
        share = numpy.arange(SAMPLES) % period / period
        return 1.0 - abs(2.0 * share - 1.0)

    drive = DRIVE_MAX_V * (0.01 + 0.6 * triangle(1181) + 0.38 * triangle(281))

    def compiled(drive):
        return with_numba(drive, THRESHOLDS, WEIGHTS_UM, SHARES, DECAYS, *MODE)

    fewer = drive[: SAMPLES // 10]
    scanned = lambda drive: with_jax(drive).block_until_ready()
    # All compute the same, and the first call compiles.
    assert numpy.allclose(with_numpy(fewer), compiled(fewer), atol=1e-9)
    assert numpy.allclose(scanned(drive), compiled(drive), atol=1e-9)
    print("program,samples,seconds")
    print(f"NumPy,{len(fewer)},{quickest_s(with_numpy, fewer, 3):.6f}")
    print(f"Numba,{len(drive)},{quickest_s(compiled, drive, RUNS):.6f}")
    print(f"JAX,{len(drive)},{quickest_s(scanned, drive, RUNS):.6f}")


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    main()
