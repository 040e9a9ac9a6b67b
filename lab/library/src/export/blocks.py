# block linear
def _linear(x, rest, phi, start, end, out, before, through, at_rest, offset):
    """y = out s + before x[k-1] + through x[k]; s = phi s + start x[k-1] + end x[k]; x and y count from offset."""
    phi, start, end, out = (np.array(v, dtype=float) for v in (phi, start, end, out))
    last = rest - offset
    s = np.array(at_rest, dtype=float) * last
    rest_out = out @ s + (before + through) * last + offset
    y = np.empty(len(x))
    for k, value in enumerate(x):
        now = value - offset
        y[k] = out @ s + before * last + through * now + offset
        s = phi.reshape(len(s), len(s)) @ s + start * last + end * now
        last = now
    return y, rest_out
# block proportional
def _proportional(x, rest, gain, offset):
    return gain * (x - offset), gain * (rest - offset)
# block clamp
def _clamp(x, rest, lower, upper):
    return np.maximum(np.minimum(x, upper), lower), max(min(rest, upper), lower)
# block slope
def _slope(x, rest, most, gives_mean):
    stands, y = rest, np.empty(len(x))
    for k, value in enumerate(x):
        start, away = stands, value - stands
        arrives = abs(away) <= most
        stands = value if arrives else start + math.copysign(most, away)
        if not gives_mean:
            y[k] = stands
        elif arrives:
            y[k] = value - away * 0.5 * (abs(away) / most if most > 0 else 1.0)
        else:
            y[k] = 0.5 * (start + stands)
    return y, rest
# block delay
def _delay(x, rest, whole, late_share):
    line = np.concatenate((np.full(whole + 1, rest), x))
    return late_share * line[: len(x)] + (1.0 - late_share) * line[1 : len(x) + 1], rest
# block loops
def _loops(x, rest, g, r, plays, rate, lower, span):
    """One-sided Preisach hysteresis: surfaces G and R in powers of (x - lower) / span, and play operators beside them."""
    pairs, memory = [], {"open": None, "input": 0.0}
    stands = [0.0] * len(plays)

    def polynomial(c, v):
        total = 0.0
        for factor in reversed(c):
            total = total * v + factor
        return total

    def loss(high, low):
        total = 0.0
        for row in reversed(g):
            total = total * high + polynomial(row, low)
        return total

    def curve(v):
        return loss(v, 0.0) + polynomial(r, v)

    def follow(value):
        v = (value - lower) / span
        last = memory["input"]
        if v > last:
            if memory["open"] is not None:
                if len(pairs) < PAIRS:
                    pairs.append((memory["open"], last))
                memory["open"] = None
            while pairs and v >= pairs[-1][0]:
                pairs.pop()
        elif v < last:
            if memory["open"] is None:
                memory["open"] = last
            while pairs and v <= pairs[-1][1]:
                memory["open"] = pairs.pop()[0]
        memory["input"] = v
        top = pairs[0][0] if pairs else (memory["open"] if memory["open"] is not None else v)
        if not pairs and memory["open"] is None:
            y = curve(v)
        else:
            y = curve(top)
            for i, (high, low) in enumerate(pairs):
                y -= loss(high, low)
                inner = pairs[i + 1][0] if i + 1 < len(pairs) else memory["open"]
                y += loss(v if inner is None else inner, low)
            if memory["open"] is not None:
                y -= loss(memory["open"], v)
        first = curve(top)
        for i, (threshold, weight) in enumerate(plays):
            stands[i] = min(max(stands[i], v - threshold), v + threshold)
            y += weight * stands[i]
            first += weight * max(top - threshold, 0.0)
        return y, first

    y = follow(rest)[0]
    rest_out, last, out = y, rest, np.empty(len(x))
    unchanged = rate[4] if rate else 1
    for k, value in enumerate(x):
        moves = value != last
        if not rate:
            if moves:
                y = follow(value)[0]
        else:
            loop_linear, loop_quadratic, curve_linear, dt, substeps = rate
            if not moves:
                unchanged += 1
            if moves or unchanged >= substeps:
                intervals = substeps if unchanged + 1 >= substeps else 1
                if moves:
                    unchanged = 0
                v = abs(value - last) / (dt * intervals) / 1e4
                still, first = follow(value)
                y = first * (1 + curve_linear * v) - (first - still) * (1 + v * (loop_linear + v * loop_quadratic))
        last = value
        out[k] = y
    return out, rest_out
# block plays
def _plays(x, rest, plays, zones, lower, span):
    stands = [0.0] * len(plays)

    def follow(value):
        v, total = (value - lower) / span, 0.0
        for i, (threshold, weight) in enumerate(plays):
            stands[i] = min(max(stands[i], v - threshold), v + threshold)
            total += weight * stands[i]
        return total + sum(weight * max(total - threshold, 0.0) for threshold, weight in zones)

    rest_out = follow(rest)
    return np.array([follow(value) for value in x]), rest_out
# block slip
def _slip(x, rest, gain, elements, lower, span):
    stretch, last = [0.0] * len(elements), [0.0]

    def follow(value):
        v, held = (value - lower) / span, 0.0
        for i, (threshold, weight) in enumerate(elements):
            stretch[i] = min(max(stretch[i] + v - last[0], -threshold), threshold)
            held += weight * stretch[i]
        last[0] = v
        return gain * v - held

    rest_out = follow(rest)
    return np.array([follow(value) for value in x]), rest_out
# block bouc_wen
def _bouc_wen(x, rest, gain, alpha, beta, gamma, lower, span):
    state = [0.0, 0.0]

    def follow(value):
        v = (value - lower) / span
        h, last = state
        pieces = int(min(max(math.ceil(abs(v - last) * 200.0), 1), 400))
        piece = (v - last) / pieces
        for _ in range(pieces):
            rate = beta * abs(piece) + gamma * piece * math.copysign(1.0, h)
            middle = h + 0.5 * (alpha * piece - rate * h)
            rate = beta * abs(piece) + gamma * piece * math.copysign(1.0, middle)
            h += alpha * piece - rate * middle
        state[:] = [h, v]
        return gain * v - h

    rest_out = follow(rest)
    return np.array([follow(value) for value in x]), rest_out
# block duhem
def _duhem(x, rest, approach, slope, elastic, lower, span):
    state = [0.0, 0.0]

    def follow(value):
        v = (value - lower) / span
        y, last = state
        change = v - last
        if change != 0.0 and approach > 1e-9:
            forcing = (elastic - slope) * math.copysign(1.0, change) / approach
            y = slope * v + forcing + (y - slope * last - forcing) * math.exp(-approach * abs(change))
        else:
            y += elastic * change
        state[:] = [y, v]
        return y

    rest_out = follow(rest)
    return np.array([follow(value) for value in x]), rest_out
# block gap
def _gap(x, rest, half):
    stands, y = rest, np.empty(len(x))
    for k, value in enumerate(x):
        stands = min(max(stands, value - half), value + half)
        y[k] = stands
    return y, rest
# block drift
def _drift(x, rest, rate, slowing):
    n = np.arange(1, len(x) + 1, dtype=float)
    slowed = slowing * n
    straight = np.abs(slowed) < 1e-9
    return x + rate * np.where(straight, n, -np.expm1(-slowed) / (slowing if slowing else 1.0)), rest
# block lines
def _lines(x, rest, lines):
    n, y, rest_out = np.arange(1, len(x) + 1, dtype=float), np.array(x, dtype=float), rest
    for angle, sine, cosine in lines:
        y += cosine * np.cos(angle * n) + sine * np.sin(angle * n)
        rest_out += cosine
    return y, rest_out
# block bend
def _bend(x, rest, quadratic, cubic):
    def bent(v):
        return v * (1.0 + v * (quadratic + v * cubic))

    return bent(x), bent(rest)
# block force
def _force(x, rest, force, substeps, compliance):
    return x + compliance * np.repeat(force, substeps)[: len(x)], rest + compliance * force[0]
