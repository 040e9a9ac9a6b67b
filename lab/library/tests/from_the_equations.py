"""Computes a model file from docs/reference/effects.md alone, with the standard library: python3 from_the_equations.py model.toml drive.txt RATE_HZ"""

import math
import sys
import tomllib


def product(a, b):
    return [[sum(x * y for x, y in zip(row, column)) for column in zip(*b)] for row in a]


def exponential(a):
    n = len(a)
    halvings = max(0, math.ceil(math.log2(max(1e-9, max(sum(map(abs, row)) for row in a)))) + 4)
    small = [[x / 2**halvings for x in row] for row in a]
    total = [[float(i == j) for j in range(n)] for i in range(n)]
    term = total
    for order in range(1, 20):
        term = [[x / order for x in row] for row in product(term, small)]
        total = [[x + y for x, y in zip(p, q)] for p, q in zip(total, term)]
    for _ in range(halvings):
        total = product(total, total)
    return total


def integral(a, b, t):
    """exp(a t) and the integral of exp(a r) b over r from 0 to t."""
    n = len(b)
    whole = exponential([[x * t for x in row] + [y * t] for row, y in zip(a, b)] + [[0.0] * (n + 1)])
    return [row[:n] for row in whole[:n]], [row[n] for row in whole[:n]]


def glide(a, b, t, tau):
    """g_0 and g_1 of an input that glides."""
    n = len(b)
    phi, held = integral(a, b, t)
    # The share that is left decays with tau: one state more, from 1 to exp(-t / tau).
    whole = exponential([[x * t for x in row] + [y * t] for row, y in zip(a, b)] + [[0.0] * n + [-t / tau]])
    left = math.exp(-t / tau)
    start = [(row[n] - left * h) / (1 - left) for row, h in zip(whole[:n], held)]
    return phi, start, [h - s for h, s in zip(held, start)]


class Linear:
    def __init__(self, a, b, t, tau):
        if tau is None:
            self.phi, self.end = integral(a, b, t)
            self.start = [0.0] * len(b)
        else:
            self.phi, self.start, self.end = glide(a, b, t, tau)

    def settle(self, state, x):
        self.state, self.last = state, x

    def step(self, x):
        self.state = [
            sum(p * s for p, s in zip(row, self.state)) + g * self.last + h * x
            for row, g, h in zip(self.phi, self.start, self.end)
        ]
        self.last = x
        return self.state


class Amplifier:
    def __init__(self, p, t):
        self.a = math.exp(-t * 2 * math.pi * p["bandwidth_hz"])

    def settle(self, x):
        self.v = x
        return x

    def step(self, x):
        self.v = x + (self.v - x) * self.a
        return self.v


class Plays:
    def __init__(self, p, low, high):
        self.weights = [p[f"weight_{i}_um"] for i in range(10)]
        self.low, self.span = low, high - low
        self.p = [0.0] * 10

    def step(self, x):
        big = (x - self.low) / self.span
        self.p = [min(max(p, big - 0.05 * i), big + 0.05 * i) for i, p in enumerate(self.p)]
        return sum(w * p for w, p in zip(self.weights, self.p))

    settle = step


def legendre(k, x):
    before, now = 1.0, 2 * x - 1
    if k == 0:
        return before
    for n in range(1, k):
        before, now = now, ((2 * n + 1) * (2 * x - 1) * now - n * before) / (n + 1)
    return now


class Hysteresis:
    def __init__(self, p, curve, low, high):
        self.g = {tuple(map(int, name.split("_")[1:3])): value for name, value in p.items()}
        self.r = [curve[f"r_{k}_um"] for k in range(len(curve))]
        self.low, self.span = low, high - low
        self.pairs, self.open, self.last = [], None, 0.0

    def loss(self, x, z):
        return (x - z) * sum(value * legendre(i, x) * legendre(j, z) for (i, j), value in self.g.items())

    def first(self, x):
        return self.loss(x, 0.0) + x * sum(r * legendre(k, x) for k, r in enumerate(self.r))

    def step(self, value):
        x = (value - self.low) / self.span
        if x > self.last:
            if self.open is not None:
                self.pairs.append((self.open, self.last))
                self.open = None
            while self.pairs and x >= self.pairs[-1][0]:
                self.pairs.pop()
        elif x < self.last:
            if self.open is None:
                self.open = self.last
            while self.pairs and x <= self.pairs[-1][1]:
                self.open = self.pairs.pop()[0]
        self.last = x
        if not self.pairs and self.open is None:
            return self.first(x)
        y = self.first(self.pairs[0][0] if self.pairs else self.open)
        behind = [m for m, _ in self.pairs[1:]] + [x if self.open is None else self.open]
        for (high, low), n in zip(self.pairs, behind):
            y -= self.loss(high, low) - self.loss(n, low)
        return y if self.open is None else y - self.loss(self.open, x)

    settle = step


class Modes:
    def __init__(self, modes, sensor_hz, t, tau):
        self.sensor = sensor_hz is not None
        rate = 2 * math.pi * (sensor_hz or 0.0)
        self.modes = []
        for share, w, damping in modes:
            a = [[0, w, 0], [-w, -2 * damping * w, 0], [rate, 0, -rate]]
            self.modes.append((share, Linear(a, [0, w, 0], t, tau)))

    def settle(self, x):
        for _, mode in self.modes:
            mode.settle([x, 0.0, x], x)
        return x

    def step(self, x):
        return sum(share * mode.step(x)[2 if self.sensor else 0] for share, mode in self.modes)


class Creep:
    def __init__(self, p, t):
        n = len(p) // 2
        self.terms = []
        for i in range(1, n + 1):
            tau = p[f"time_constant_{i}_s"]
            a = math.exp(-t / tau)
            self.terms.append((p[f"share_{i}"], a, (1 - a) * tau / t))

    def settle(self, x):
        self.s, self.last = [x] * len(self.terms), x
        return x + sum(share * x for share, _, _ in self.terms)

    def step(self, x):
        self.s = [a * s + (m - a) * self.last + (1 - m) * x for (_, a, m), s in zip(self.terms, self.s)]
        self.last = x
        return x + sum(share * s for (share, _, _), s in zip(self.terms, self.s))


class Drift:
    def __init__(self, p, t):
        self.rate, self.slowing, self.t, self.k = p["rate_um_s"], p["slowing_per_s"], t, 0

    def settle(self, x):
        return x

    def step(self, x):
        self.k += 1
        t = self.k * self.t
        return x + self.rate * (t if abs(self.slowing * t) < 1e-9 else -math.expm1(-self.slowing * t) / self.slowing)


class Rounding:
    def __init__(self, p):
        self.lsb = p["lsb_um"]

    def step(self, x):
        return math.copysign(math.floor(abs(x) / self.lsb + 0.5), x) * self.lsb

    settle = step


def main(model_file, drive_file, rate_hz):
    with open(model_file, "rb") as file:
        model = tomllib.load(file)
    effects = {e["id"]: {p["name"]: p["value"] for p in e["parameter"]} for e in model["effect"]}
    low, high = model["drive_min_v"], model["drive_max_v"]
    drive = [float(line) for line in open(drive_file)]
    period = 1.0 / rate_hz
    amplifier = effects.get("amplifier_bandwidth")
    # With a mode behind an amplifier the period is divided into 2 above 25 us; all behind the amplifier goes
    # so but for the last effects.
    n = 2 if amplifier and period > 25e-6 and "vibration" in effects else 1
    t = period / n
    tau = 1 / (2 * math.pi * amplifier["bandwidth_hz"]) if amplifier else None
    fine, coarse = [], []
    if amplifier:
        fine.append(Amplifier(amplifier, t))
    if "hysteresis" in effects:
        fine.append(Hysteresis(effects["hysteresis"], effects.get("initial_curve", {}), low, high))
    if "prandtl_ishlinskii" in effects:
        fine.append(Plays(effects["prandtl_ishlinskii"], low, high))
    if "vibration" in effects:
        mode, second = effects["vibration"], effects.get("second_mode")
        share = second["share"] if second else 0.0
        modes = [(1 - share, mode["natural_frequency_rad_s"], mode["damping_ratio"])]
        if second:
            modes.append((share, second["natural_frequency_rad_s"], second["damping_ratio"]))
        sensor = effects.get("sensor_bandwidth")
        fine.append(Modes(modes, sensor["bandwidth_hz"] if sensor else None, t, tau))
    if "creep" in effects:
        coarse.append(Creep(effects["creep"], period))
    if "thermal_drift" in effects:
        coarse.append(Drift(effects["thermal_drift"], period))
    if "quantisation" in effects:
        coarse.append(Rounding(effects["quantisation"]))
    rest = low
    for effect in fine + coarse:
        rest = effect.settle(rest)
    readings = [rest]
    for u in drive[:-1]:
        for _ in range(n):
            y = u
            for effect in fine:
                y = effect.step(y)
        for effect in coarse:
            y = effect.step(y)
        readings.append(y)
    for reading in readings:
        print(repr(reading))


main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
