#!/usr/bin/env python3
"""Structures of hysteresis on the recordings of a real piezo stage, judged on records that they were not fitted to.

    python3 benchmarks/public/real_stage.py --data FOLDER [--pictures docs/pictures]

FOLDER holds `piezo_stage`. Needs NumPy, SciPy and Numba. Prints the table of docs/results/real_stage.md. Every structure is
a density over threshold and position of play operators, a cubic of the drive, creep and the 735 Hz mode. Each is fitted by
linear least squares to four sets of records and judged on all of them. With `--pictures` it draws what the last structure
leaves on records that it was not fitted to.
"""

import argparse
from pathlib import Path

import numpy as np
from numba import njit
from scipy.signal import cont2discrete, lfilter

ARGUMENTS = argparse.ArgumentParser(description=__doc__)
ARGUMENTS.add_argument("--data", type=Path, required=True)
ARGUMENTS.add_argument("--pictures", type=Path)

RATE_HZ, ATTEMPT_S, DELAY_S, RESTED_S = 1e4, 1e-4, 1.5e-4, 10.0
LOWER_V, LARGEST_V, PLAYS, SIZES, LEVELS = -95.0, 100.0, 32, 5, 5
TIMES_S = (1e-3, 1e-2, 0.1, 1.0, 10.0)
FROM_S = {"20_hz_no_lp": 1.5, "40_hz_no_lp": 1.5, "sine50_1": 1.0, "tri50_1": 1.0}
LEAD_S = 0.02
NAMES = tuple(FROM_S)
SETS = (NAMES, ("20_hz_no_lp", "sine50_1"), ("40_hz_no_lp", "tri50_1"), ("20_hz_no_lp", "40_hz_no_lp"))

EDGES = np.arange(PLAYS + 1)
THRESHOLDS = LARGEST_V * ((EDGES[:-1] + 0.5) / PLAYS) ** 1.5
SHARES = np.diff((EDGES / PLAYS) ** 1.5)


@njit
def follow(position, drive, width, lost):
    """Where a play without sharp edges goes in an interval in which the drive is constant."""
    q = np.exp(-np.abs(drive - position) / width)
    left = -np.log((lost + q * (2 - lost)) / (2 - lost + q * lost))
    return drive - np.sign(drive - position) * max(left, 0.0) * width


@njit
def walk(drive, start, width, lost):
    out = np.empty((len(start), len(drive)))
    for j in range(len(start)):
        position = start[j]
        for k in range(len(drive)):
            position = follow(position, drive[k], width[j], lost)
            out[j, k] = position
    return out


def lost_in(activation, length_s):
    return -np.expm1(-2 * length_s / ATTEMPT_S * np.exp(-1 / activation))


def positions(drive, held_s, activation):
    """Of all plays: first where they rest at 0 V, reached from the lower limit, then along the drive."""
    width = activation * THRESHOLDS
    hold = lambda start, volt, time: np.array([follow(z, volt, w, lost_in(activation, time)) for z, w in zip(start, width)])
    rest = hold(LOWER_V + THRESHOLDS, 0.0, RESTED_S)
    begin = hold(rest, drive[0], held_s)
    return np.column_stack([rest, walk(drive, begin, width, lost_in(activation, 1 / RATE_HZ))])


def density(z):
    by_size = np.polynomial.legendre.legvander(2 * np.sqrt(THRESHOLDS / LARGEST_V) - 1, SIZES - 1) * SHARES[:, None]
    by_level = np.polynomial.legendre.legvander(z / LARGEST_V, LEVELS)[..., 1:]
    return np.einsum("js,jkl->slk", by_size, by_level).reshape(SIZES * LEVELS, -1)


def mean_over(x, time_s, held_s):
    """Low-pass; the first column is the rest before the record, the second follows a hold."""
    pole, before = np.exp(-1 / RATE_HZ / time_s), np.exp(-held_s / time_s)
    first = x[..., 1:2] + (x[..., :1] - x[..., 1:2]) * before
    out, _ = lfilter([1 - pole], [1, -pole], x[..., 1:], zi=pole * first, axis=-1)
    return np.concatenate([x[..., :1], out], -1)


def mode(x, frequency_hz=735.0, damping=0.014):
    w = 2 * np.pi * frequency_hz
    b, a, _ = cont2discrete(([w * w], [1, 2 * damping * w, w * w]), 1 / RATE_HZ, method="foh")
    return lfilter(b.ravel(), a, x - x[:, :1], axis=-1) + x[:, :1]


def load(folder):
    records = {}
    for name in NAMES:
        t, u, y = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1).T
        # The 50 Hz records end with a jump.
        keep = slice(int((FROM_S[name] - LEAD_S) * RATE_HZ), len(t) - (0 if "hz" in name else 8))
        records[name] = (t[keep], np.interp(t - DELAY_S, t, u)[keep], y[keep], FROM_S[name] - LEAD_S)
    return records


def log_creep(x, held_s):
    return sum(mean_over(x, time, held_s) for time in TIMES_S)


# Of the drive s, the switching part h, the rest l and the time before: what a structure adds.
def none(s, h, l, held):
    return []


def creep(s, h, l, held):
    return [log_creep(s, held)]


def relaxing(s, h, l, held):
    return [log_creep(s, held)] + [mean_over(h, time, held) for time in TIMES_S[:4]]


def quadratic(s, h, l, held):
    return [log_creep(s, held), (h + l) ** 2]


def product(s, h, l, held):
    return [log_creep(s, held), s * h]


def both(s, h, l, held):
    return [log_creep(s, held), (h + l) ** 2, s * h]


def bias(time_s):
    return lambda s, h, l, held: [log_creep(s, held), s * mean_over(h + l, time_s, held)]


STRUCTURES = (
    ("plays with sharp edges, creep", 0.002, creep, 1),
    ("the same, and relaxation of the switching part", 0.002, relaxing, 3),
    ("activated plays, no creep", 0.031, none, 1),
    ("activated plays, creep", 0.031, creep, 1),
    ("the same, activation 0.025", 0.025, creep, 1),
    ("the same, activation 0.04", 0.04, creep, 1),
    ("and relaxation of the switching part", 0.031, relaxing, 3),
    ("and strain quadratic in polarisation", 0.031, quadratic, 3),
    ("and drive times switching part", 0.031, product, 3),
    ("and both", 0.031, both, 3),
    ("and a gain by the bias over 0.03 s", 0.031, bias(0.03), 3),
    ("and a gain by the bias over 0.1 s", 0.031, bias(0.1), 3),
    ("and a gain by the bias over 1 s", 0.031, bias(1.0), 3),
)


def judge(parts, records, fitted, extra, rounds):
    """Residuals in um of all records by a fit to some."""
    solution = None
    for _ in range(rounds):
        normal, right, regressors = 0.0, 0.0, {}
        for name, (switching, s) in parts.items():
            t, _, y, held_s = records[name]
            plain = np.array([s, s**2, s**3])
            count = len(switching)
            h = solution[:count] @ switching if solution is not None else 0 * s
            l = solution[count : count + 3] @ plain if solution is not None else 0 * s
            rows = mode(np.vstack([switching, plain, *extra(s, h, l, held_s)])[:, 1:])
            regressors[name] = rows
            if name in fitted:
                x, e = rows[:, ::3], y[::3] - y[::3].mean()
                x = x - x.mean(1, keepdims=True)
                normal, right = normal + x @ x.T / len(e), right + x @ e / len(e)
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        ridge = 1e-6 * np.eye(len(scale))
        solution = np.linalg.solve(normal / np.outer(scale, scale) + ridge, right / scale) / scale
    out = {}
    for name, rows in regressors.items():
        t, _, y, _ = records[name]
        left = y - solution @ rows
        out[name] = left - left[t >= FROM_S[name]].mean()
    return out


def picture(path, panels):
    """Lines in boxes, one under the other: title, label of the abscissa, x, y in nm."""
    width, height, rows = 760, 130, []
    for i, (title, label, x, y) in enumerate(panels):
        top, low, high = 20 + i * (height + 34), x.min(), x.max()
        across = 60 + (x - low) / (high - low) * (width - 80)
        down = top + height / 2 - np.clip(y, -100, 100) / 200 * height
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across, down))
        rows.append(f'<rect x="60" y="{top}" width="{width - 80}" height="{height}" fill="none" stroke="#999"/>')
        rows.append(f'<line x1="60" x2="{width - 20}" y1="{top + height / 2}" y2="{top + height / 2}" stroke="#ccc"/>')
        rows.append(f'<polyline points="{points}" fill="none" stroke="#1f5a96" stroke-width="0.7"/>')
        rows.append(f'<text x="66" y="{top + 13}">{title}</text><text x="{width - 20}" y="{top + height + 13}" text-anchor="end">{label}</text>')
        rows.append(f'<text x="54" y="{top + 10}" text-anchor="end">100 nm</text><text x="54" y="{top + height}" text-anchor="end">-100</text>')
        rows.append(f'<text x="60" y="{top + height + 13}">{low:.3g}</text>')
    total = 20 + len(panels) * (height + 34)
    style = "<style>text { font: 11px sans-serif; fill: #333 }</style>"
    path.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {total}" width="{width}" height="{total}">'
        f'<rect width="100%" height="100%" fill="white"/>{style}{"".join(rows)}</svg>\n'
    )


def main():
    options = ARGUMENTS.parse_args()
    folder = options.data / "piezo_stage"
    if not folder.is_dir():
        print("skipped: no measured data")
        return
    records = load(folder)
    cache = {}

    def parts_at(activation):
        if activation not in cache:
            cache.clear()
            cache[activation] = {
                name: (density(positions(u, held, activation)), np.concatenate([[0.0], u / LARGEST_V]))
                for name, (_, u, _, held) in records.items()
            }
        return cache[activation]

    print("| structure | all four | 20 Hz, sine | 40 Hz, tri | 20, 40 Hz |\n|---|---|---|---|---|")
    left = {}
    for label, activation, extra, rounds in STRUCTURES:
        cells = []
        for fitted in SETS:
            left = judge(parts_at(activation), records, fitted, extra, rounds)
            error = lambda n: 1e3 * left[n][records[n][0] >= FROM_S[n]].std()
            cells.append(" ".join(f"**{error(n):.0f}**" if n not in fitted else f"{error(n):.0f}" for n in NAMES))
        print(f"| {label} | " + " | ".join(cells) + " |", flush=True)
    if options.pictures:
        extra = bias(1.0)
        crossed = {}
        for fitted in SETS[1:3]:
            found = judge(parts_at(0.031), records, fitted, extra, 3)
            crossed.update({n: found[n] for n in NAMES if n not in fitted})
        over_time, over_drive = [], []
        for name in NAMES:
            t, u, _, _ = records[name]
            thin = slice(int(LEAD_S * RATE_HZ), None, 8)
            over_time.append((f"{name}, held out", "time, s", t[thin], 1e3 * crossed[name][thin]))
            over_drive.append((f"{name}, held out", "drive, V", u[thin], 1e3 * crossed[name][thin]))
        picture(options.pictures / "real_stage_time.svg", over_time)
        picture(options.pictures / "real_stage_drive.svg", over_drive)


if __name__ == "__main__":
    main()
