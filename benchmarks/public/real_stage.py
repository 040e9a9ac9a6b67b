#!/usr/bin/env python3
"""Structures of hysteresis on the recordings of a real piezo stage, judged on records that they were not fitted to.

    python3 benchmarks/public/real_stage.py --data FOLDER [--pictures docs/pictures]

FOLDER holds `piezo_stage`. Needs NumPy, SciPy and Numba. Prints the table of docs/results/real_stage.md. Every structure is
a density over threshold and position of play operators, a cubic of the drive, creep and the 735 Hz mode. Each is fitted by
linear least squares to four sets of records and judged on all of them. A second table gives every held-out record the state
before it that serves its first third best. With `--pictures` it draws what the last structure leaves on records that it was
not fitted to.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

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
# The play whose edge no power changes.
ALIKE_V = 30.0
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
    """All plays along a drive; `lost` is of each."""
    out = np.empty((len(start), len(drive)))
    for j in range(len(start)):
        position = start[j]
        for k in range(len(drive)):
            position = follow(position, drive[k], width[j], lost[j])
            out[j, k] = position
    return out


def positions(drive, held_s, shape):
    """Of all plays: first where they rest at 0 V behind the last turn of a drive, then along the drive."""
    width = shape.activation * ALIKE_V * (THRESHOLDS / ALIKE_V) ** shape.power
    lost_in = lambda time: -np.expm1(-2 * time / ATTEMPT_S * np.exp(-THRESHOLDS / width))
    hold = lambda start, volt, time: np.array([follow(*of) for of in zip(start, np.full(PLAYS, volt), width, lost_in(time))])
    rest = hold(shape.turn_v + shape.side * THRESHOLDS, 0.0, RESTED_S)
    begin = hold(rest, drive[0], held_s)
    return np.column_stack([rest, walk(drive, begin, width, lost_in(1 / RATE_HZ))])


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


class Shape(NamedTuple):
    """Widths of the edges of plays, as a share of a power of their thresholds, and the state before a record.

    The power leaves that of the play of 30 V as it is. The last turn before it is at `turn_v`; `side` is 1 where the drive fell there from far above, -1 where it rose.
    """

    activation: float = 0.031
    power: float = 1.0
    turn_v: float = LOWER_V
    side: float = 1.0


STRUCTURES = (
    ("plays with sharp edges, creep", Shape(0.002), creep, 1),
    ("the same, and relaxation of the switching part", Shape(0.002), relaxing, 3),
    ("activated plays, no creep", Shape(), none, 1),
    ("activated plays, creep", Shape(), creep, 1),
    ("the same, activation 0.025", Shape(0.025), creep, 1),
    ("the same, activation 0.04", Shape(0.04), creep, 1),
    ("edges as wide as that of a play of 30 V", Shape(power=0.0), creep, 1),
    ("edges that grow with the root of the threshold", Shape(power=0.5), creep, 1),
    ("the same, activation 0.045", Shape(0.045, power=0.5), creep, 1),
    ("plays that begin at 0 V", Shape(turn_v=0.0, side=0.0), creep, 1),
    ("activated plays, creep, relaxation of the switching part", Shape(), relaxing, 3),
    ("activated plays, creep, strain quadratic in polarisation", Shape(), quadratic, 3),
    ("activated plays, creep, drive times switching part", Shape(), product, 3),
    ("activated plays, creep, both of these", Shape(), both, 3),
    ("activated plays, creep, a gain by the bias over 0.03 s", Shape(), bias(0.03), 3),
    ("activated plays, creep, a gain by the bias over 0.1 s", Shape(), bias(0.1), 3),
    ("activated plays, creep, a gain by the bias over 1 s", Shape(), bias(1.0), 3),
)


def regressors(part, record, extra, solution):
    switching, s = part
    plain = np.array([s, s**2, s**3])
    count = len(switching)
    h = solution[:count] @ switching if solution is not None else 0 * s
    l = solution[count : count + 3] @ plain if solution is not None else 0 * s
    return mode(np.vstack([switching, plain, *extra(s, h, l, record[3])])[:, 1:])


def judge(parts, records, fitted, extra, rounds):
    """Residuals in um of all records by a fit to some, and its coefficients."""
    solution = None
    for _ in range(rounds):
        normal, right, of_each, before = 0.0, 0.0, {}, solution
        for name, part in parts.items():
            y = records[name][2]
            rows = of_each[name] = regressors(part, records[name], extra, before)
            if name in fitted:
                x, e = rows[:, ::3], y[::3] - y[::3].mean()
                x = x - x.mean(1, keepdims=True)
                normal, right = normal + x @ x.T / len(e), right + x @ e / len(e)
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-30))
        ridge = 1e-6 * np.eye(len(scale))
        solution = np.linalg.solve(normal / np.outer(scale, scale) + ridge, right / scale) / scale
    out = {}
    for name, rows in of_each.items():
        t, _, y, _ = records[name]
        left = y - solution @ rows
        out[name] = left - left[t >= FROM_S[name]].mean()
    return out, solution


def with_other_states(parts_of, name, record, extra, solution):
    """Errors in nm on the last two thirds of a record: with a sweep before it, with the state that serves its first third
    best, and with the one that serves the rest best."""
    judged = record[0] >= FROM_S[name]
    tried = []
    for turn_v in (LOWER_V, -70.0, -45.0, 0.0, 45.0, 95.0):
        for side in (1.0, 0.5, 0.0, -0.5, -1.0):
            rows = regressors(parts_of(name, Shape(turn_v=turn_v, side=side)), record, extra, solution)
            left = 1e3 * (record[2] - solution @ rows)[judged]
            first, rest = np.split(left, [len(left) // 3])
            tried.append((first.std(), np.sqrt(((rest - first.mean()) ** 2).mean()), turn_v, side))
    return tried[0], min(tried), min(tried, key=lambda of: of[1])


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


def what_remains(name, record, left_nm):
    t, u, _, _ = record
    judged = t >= FROM_S[name]
    # The drives at 5 Hz carry a ripple.
    smooth = u if "hz" in name else lfilter(np.ones(20) / 20, [1], u)
    rising, left = (np.gradient(smooth) > 0)[judged], left_nm[judged]
    turns = np.flatnonzero(np.diff(rising.astype(int)))
    since = np.arange(len(left)) - turns[np.maximum(np.searchsorted(turns, np.arange(len(left))) - 1, 0)]
    rms = lambda x: f"{np.sqrt((x**2).mean()):.0f}"
    return (
        ", ".join(rms(x) for x in np.array_split(left, 3)),
        f"{left[rising].mean():.0f}, {left[~rising].mean():.0f}",
        ", ".join(f"{left[(since >= a) & (since < b)].std():.0f}" for a, b in ((0, 20), (20, 60), (60, 150))),
    )


def main():
    options = ARGUMENTS.parse_args()
    folder = options.data / "piezo_stage"
    if not folder.is_dir():
        print("skipped: no measured data")
        return
    records = load(folder)
    cache = {}

    def part_of(name, shape):
        _, u, _, held_s = records[name]
        return density(positions(u, held_s, shape)), np.concatenate([[0.0], u / LARGEST_V])

    def parts_at(shape):
        if shape not in cache:
            cache.clear()
            cache[shape] = {name: part_of(name, shape) for name in records}
        return cache[shape]

    print("| structure | all four | 20 Hz, sine | 40 Hz, tri | 20, 40 Hz |\n|---|---|---|---|---|")
    left = {}
    for label, shape, extra, rounds in STRUCTURES:
        cells = []
        for fitted in SETS:
            left, _ = judge(parts_at(shape), records, fitted, extra, rounds)
            error = lambda n: 1e3 * left[n][records[n][0] >= FROM_S[n]].std()
            cells.append(" ".join(f"**{error(n):.0f}**" if n not in fitted else f"{error(n):.0f}" for n in NAMES))
        print(f"| {label} | " + " | ".join(cells) + " |", flush=True)
    print("\n| fitted | held out | a sweep before it | best on its first third | best on the rest |\n|---|---|---|---|---|")
    for label, extra, rounds in (("creep", creep, 1), ("and a gain by the bias over 1 s", bias(1.0), 3)):
        for fitted in SETS[1:]:
            _, solution = judge(parts_at(Shape()), records, fitted, extra, rounds)
            for name in (n for n in NAMES if n not in fitted):
                states = with_other_states(part_of, name, records[name], extra, solution)
                cells = [f"{first:.0f}, {rest:.0f}" + f" ({turn_v:.0f} V, {side:g})" * (i > 0) for i, (first, rest, turn_v, side) in enumerate(states)]
                print(f"| {label}: {', '.join(fitted)} | {name} | " + " | ".join(cells) + " |", flush=True)
    crossed = {}
    for fitted in SETS[1:3]:
        found, _ = judge(parts_at(Shape()), records, fitted, bias(1.0), 3)
        crossed.update({n: found[n] for n in NAMES if n not in fitted})
    print("\n| held out | thirds of the record, nm | mean on rising, falling, nm | within 2, 6, 15 ms of a turn, nm |")
    print("|---|---|---|---|")
    for name in NAMES:
        print(f"| {name} | " + " | ".join(what_remains(name, records[name], 1e3 * crossed[name])) + " |")
    if options.pictures:
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
