"""Candidate terms for general methods, and which physical effects each of them stands for.

A general method picks terms that explain what a nominal model leaves. Every effect of the library that can be written as a term of known
shape has one here, computed from what is known of a record: time, drive, force, and what the nominal model says the sensor reads. What a term stands for
was written down before any method was run. Where one term is the first order of several effects (a delay, a lag in the amplifier, a lag in the
sensor), it stands for all of them, and is right where one of them is: the most generous reading.
"""

import numpy as np
from scipy.signal import lfilter

LAGS = ("delay", "sensor_bandwidth", "amplifier_bandwidth")
SECOND_ORDER = ("vibration", "second_mode", "sensor_filter", "mass_change")

# Names of terms and the effects that each stands for.
MEANS = {
    "rate of the displacement": LAGS,
    "rate of the drive": LAGS,
    "acceleration of the displacement": SECOND_ORDER,
    "acceleration of the drive": SECOND_ORDER,
    **{f"mode at {hz} Hz": SECOND_ORDER for hz in (300, 600, 1000, 1500, 2000, 3000)},
    **{f"creep of {tau} s": ("creep",) for tau in (0.02, 0.2, 2.0, 20.0)},
    **{f"leakage of {tau} s": ("charge_leakage",) for tau in (1.0, 10.0)},
    "displacement": ("gain", "hysteresis"),
    "drive": ("gain", "hysteresis"),
    "square of the displacement": ("sensor_nonlinearity",),
    "cube of the displacement": ("sensor_nonlinearity",),
    "square of the drive": ("hysteresis",),
    **{f"backlash of {share} of the range": ("hysteresis", "play_operators") for share in (0.1, 0.25, 0.5)},
    "highest drive so far": ("initial_curve",),
    "backlash of the displacement, 50 nm": ("friction",),
    "backlash of the displacement, 200 nm": ("friction",),
    "direction of the displacement": ("friction",),
    "loops that follow late": ("rate_dependence",),
    "loops by the logarithm of the rate": ("rate_dependence",),
    "sine of 50 Hz": ("mains_hum",),
    "cosine of 50 Hz": ("mains_hum",),
    "time": ("thermal_drift",),
    "warming within 20 s": ("thermal_drift",),
    "force": ("load_force",),
    **{f"drive beyond {share} of its top": ("saturation",) for share in (0.6, 0.7, 0.8, 0.9)},
    **{f"rate beyond {share} of the fastest": ("slew_limit",) for share in (0.3, 0.6)},
}


def play(x, radius):
    """The play operator: backlash of a half width."""
    out = np.empty_like(x)
    state = 0.0
    for k, value in enumerate(x):
        state = min(max(state, value - radius), value + radius)
        out[k] = state
    return out


def lagged(x, tau_s, dt_s):
    """A first-order lag of a signal that begins at rest at its first value."""
    decay = np.exp(-dt_s / tau_s)
    return x[0] + lfilter([1.0 - decay], [1.0, -decay], x - x[0])


def mode(x, hz, dt_s):
    """What a mode of 10 % damping adds to a signal."""
    w, damping = 2.0 * np.pi * hz, 0.1
    if w * dt_s > 2.0:
        return np.zeros_like(x)
    a = np.exp(-damping * w * dt_s)
    poles = 2.0 * a * np.cos(w * dt_s * np.sqrt(1.0 - damping**2))
    gain = 1.0 - poles + a * a
    return lfilter([0.0, gain], [1.0, -poles, a * a], x - x[0]) - (x - x[0])


def terms(t_s, drive_v, modelled_um, force_n):
    """All terms of one record, by name."""
    dt_s = t_s[1] - t_s[0]
    low, high = drive_v.min(), drive_v.max()
    span = max(high - low, 1e-9)
    rate_u, rate_y = np.gradient(drive_v, dt_s), np.gradient(modelled_um, dt_s)
    fastest = max(np.abs(rate_u).max(), 1e-9)
    speed_y = max(np.sqrt(np.mean(rate_y**2)), 1e-9)
    loops = play(drive_v - low, 0.15 * span)
    out = {
        "rate of the displacement": rate_y,
        "rate of the drive": rate_u,
        "acceleration of the displacement": np.gradient(rate_y, dt_s),
        "acceleration of the drive": np.gradient(rate_u, dt_s),
        "displacement": modelled_um,
        "drive": drive_v,
        "square of the displacement": modelled_um**2,
        "cube of the displacement": modelled_um**3,
        "square of the drive": drive_v**2,
        "highest drive so far": np.maximum.accumulate(drive_v),
        "backlash of the displacement, 50 nm": modelled_um - play(modelled_um, 0.05),
        "backlash of the displacement, 200 nm": modelled_um - play(modelled_um, 0.2),
        "direction of the displacement": np.tanh(10.0 * rate_y / speed_y),
        "loops that follow late": np.gradient(loops, dt_s),
        "loops by the logarithm of the rate": np.sign(rate_u) * np.log1p(np.abs(rate_u) / (1e-3 * fastest)),
        "sine of 50 Hz": np.sin(2.0 * np.pi * 50.0 * t_s),
        "cosine of 50 Hz": np.cos(2.0 * np.pi * 50.0 * t_s),
        "time": t_s - t_s[0],
        "warming within 20 s": 1.0 - np.exp(-(t_s - t_s[0]) / 20.0),
        "force": np.zeros_like(t_s) if force_n is None else force_n,
    }
    for hz in (300, 600, 1000, 1500, 2000, 3000):
        out[f"mode at {hz} Hz"] = mode(modelled_um, hz, dt_s)
    for tau_s in (0.02, 0.2, 2.0, 20.0):
        out[f"creep of {tau_s} s"] = lagged(modelled_um, tau_s, dt_s)
    for tau_s in (1.0, 10.0):
        out[f"leakage of {tau_s} s"] = lagged(drive_v, tau_s, dt_s)
    for share in (0.1, 0.25, 0.5):
        out[f"backlash of {share} of the range"] = play(drive_v - low, 0.5 * share * span)
    for share in (0.6, 0.7, 0.8, 0.9):
        out[f"drive beyond {share} of its top"] = np.maximum(drive_v - share * high, 0.0)
    for share in (0.3, 0.6):
        out[f"rate beyond {share} of the fastest"] = np.sign(rate_u) * np.maximum(np.abs(rate_u) - share * fastest, 0.0)
    assert out.keys() == MEANS.keys()
    return out
