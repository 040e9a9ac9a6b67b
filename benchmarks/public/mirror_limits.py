#!/usr/bin/env python3
"""What limits a model of the fine steering mirror: errors of responses that are free in every line.

    python3 benchmarks/public/mirror_limits.py --data FOLDER

FOLDER holds `fine_steering_mirror`. Needs NumPy. Of each level the last realisation is held out. A response without any
structure is fitted line by line, to one level or to all of them, alone or beside forces that act where the drives act:
play operators of each drive, of the extension of each actuator, powers of its velocity, and extension and velocity
times the RMS extension over a time. The extension is the combination of the sensors whose response to the drives is
symmetric, as reciprocity has it.
"""

import argparse
import pathlib

import numpy

LEVELS = (100, 200, 300)
RATE_HZ = 6400.0
PERIOD = 8192
# Lines that the drives excite.
LINES = numpy.arange(1, 3840)
BANDS_HZ = ((0, 500), (500, 700), (700, 860), (860, 950), (950, 1100), (1100, 1600), (1600, 3000))
# Thresholds of the play operators, in standard deviations of what they follow at the highest level.
THRESHOLDS = (0.03, 0.1, 0.25, 0.5, 1.0, 1.7)
# Times over which an actuator remembers that it moved.
MEMORIES_S = (0.001, 0.01, 0.03, 0.1, 0.3, 3.0)


def play(signal, threshold):
    """A play operator on periods, each in its steady state."""
    state = numpy.zeros(len(signal))
    out = numpy.empty_like(signal)
    for _ in range(2):
        for k in range(signal.shape[1]):
            state = numpy.clip(state, signal[:, k] - threshold, signal[:, k] + threshold)
            out[:, k] = state
    return out


def softening(signal, memory_s):
    """The extension and its velocity, times the RMS extension over the time before, on periods."""
    turns = 2j * numpy.pi * numpy.arange(PERIOD // 2 + 1) * RATE_HZ / PERIOD
    back = lambda spectrum: numpy.fft.irfft(spectrum, PERIOD, axis=1)
    square = back(numpy.fft.rfft(signal**2, axis=1) / (1 + turns * memory_s))
    rms = numpy.sqrt(numpy.maximum(square, 0.0))
    return [rms * signal, rms * back(turns * numpy.fft.rfft(signal, axis=1))]


def spectra(signals):
    return numpy.fft.rfft(signals, axis=1)[:, LINES]


class Mirror:
    def __init__(self, folder):
        u, y, noisy = [], [], []
        for level in LEVELS:
            drives, sensors = (numpy.load(folder / f"{name}_{level}mV_train.npy") for name in "uy")
            scatter = (sensors[..., 0] - sensors[..., 1]).std(axis=(0, 1))
            noisy += list(scatter > 2.0 * numpy.median(scatter))
            u += list(drives.mean(-1).transpose(2, 0, 1))
            y += list(1e6 * sensors.mean(-1).transpose(2, 0, 1))
        self.u, self.y = numpy.array(u), numpy.array(y)
        self.level = numpy.repeat(range(len(LEVELS)), len(u) // len(LEVELS))
        self.held_out = numpy.tile(numpy.arange(len(u) // len(LEVELS)), len(LEVELS)) == len(u) // len(LEVELS) - 1
        # Realisations whose periods differ twice as much as the others' were disturbed.
        self.fitted = ~self.held_out & ~numpy.array(noisy)
        # Lines by channels by records; every level counts alike.
        self.drives = spectra(self.u).transpose(1, 2, 0)
        self.sensors = spectra(self.y).transpose(1, 2, 0)
        self.weight = 1.0 / numpy.array(LEVELS)[self.level]

    def response(self, of, records):
        u, y = self.drives[:, :, records] * self.weight[records], of[:, :, records] * self.weight[records]
        adjoint = u.conj().transpose(0, 2, 1)
        return (y @ adjoint) @ numpy.linalg.inv(u @ adjoint)

    def errors(self, model, lines=slice(None)):
        """Of each level, on these lines, of the whole output."""
        left = (self.sensors - model)[lines]
        of = lambda level: self.held_out & (self.level == level)
        share = lambda n: 100 * numpy.sqrt((abs(left[:, :, of(n)]) ** 2).sum() / (abs(self.sensors[:, :, of(n)]) ** 2).sum())
        return [share(n) for n in range(len(LEVELS))]

    def linear(self, by_level):
        model = numpy.empty_like(self.sensors)
        for n in range(len(LEVELS)):
            # A level has too few realisations to leave the disturbed ones out.
            records = ~self.held_out & (self.level == n) if by_level else self.fitted
            of = self.level == n
            model[:, :, of] = self.response(self.sensors, records) @ self.drives[:, :, of]
        return model

    def beside(self, forces):
        """One response of all levels beside forces that enter where a drive does, their sizes fitted."""
        response = self.response(self.sensors, self.fitted)
        for _ in range(3):
            given = [response[:, :, drive, None] * spectrum.T[:, None, :] for drive, spectrum in forces]
            of_own = lambda of: of[:, :, self.fitted] * self.weight[self.fitted] - self.response(of, self.fitted) @ (
                self.drives[:, :, self.fitted] * self.weight[self.fitted]
            )
            real = lambda of: numpy.concatenate([of_own(of).real.ravel(), of_own(of).imag.ravel()])
            columns = numpy.array([real(one) for one in given])
            gram = columns @ columns.T
            scale = 1 / numpy.sqrt(numpy.diag(gram))
            gram = gram * scale[:, None] * scale + 1e-9 * numpy.eye(len(scale))
            sizes = scale * numpy.linalg.solve(gram, scale * (columns @ real(self.sensors)))
            sum_of_forces = sum(size * one for size, one in zip(sizes, given))
            response = self.response(self.sensors - sum_of_forces, self.fitted)
        return response @ self.drives + sum_of_forces

    def plays(self, signals):
        forces = []
        for drive in range(3):
            size = signals[drive][self.level == len(LEVELS) - 1].std()
            forces += [(drive, spectra(play(signals[drive], threshold * size))) for threshold in THRESHOLDS]
        return forces

    def extensions(self):
        """The extension of each actuator, and how far its response is from symmetric."""
        response = self.response(self.sensors, self.fitted)[60:3600]
        weight = 1 / numpy.linalg.norm(response, axis=(1, 2))
        rows = []
        for a, b in ((0, 1), (0, 2), (1, 2)):
            of = numpy.zeros((len(response), 9), complex)
            for sensor in range(3):
                of[:, 3 * a + sensor] += response[:, sensor, b]
                of[:, 3 * b + sensor] -= response[:, sensor, a]
            rows.append(of * weight[:, None])
        rows = numpy.concatenate(rows)
        _, singular, right = numpy.linalg.svd(numpy.concatenate([rows.real, rows.imag]), full_matrices=False)
        combination = right[-1].reshape(3, 3)
        print(f"  singular values of asymmetry: smallest {singular[-1]:.1f}, next {singular[-2]:.1f}")
        return [self.y @ combination[drive] for drive in range(3)]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=pathlib.Path, required=True)
    mirror = Mirror(parser.parse_args().data / "fine_steering_mirror")
    shown = lambda errors: " ".join(f"{error:6.2f}" for error in errors)
    print("held-out error at 100, 200 and 300 mV, % of the output")
    print(f"  {'a response of each level':48} {shown(mirror.errors(mirror.linear(True)))}")
    print(f"  {'one response of all levels':48} {shown(mirror.errors(mirror.linear(False)))}")
    print(f"  {'and play operators of each drive':48} {shown(mirror.errors(mirror.beside(mirror.plays(mirror.u.transpose(2, 0, 1)))))}")
    extension = mirror.extensions()
    of_extension = mirror.plays(extension)
    model = mirror.beside(of_extension)
    print(f"  {'and play operators of each extension':48} {shown(mirror.errors(model))}")
    for memory_s in MEMORIES_S:
        forces = [(drive, spectra(force)) for drive in range(3) for force in softening(extension[drive], memory_s)]
        print(f"  {f'and extension by its RMS over {memory_s} s':48} {shown(mirror.errors(mirror.beside(forces)))}")
    velocity = []
    for drive in range(3):
        turns = 2j * numpy.pi * numpy.arange(PERIOD // 2 + 1)
        speed = numpy.fft.irfft(numpy.fft.rfft(extension[drive], axis=1) * turns, PERIOD, axis=1)
        velocity.append((drive, spectra(abs(speed) * speed)))
    with_velocity = mirror.beside(of_extension + velocity)
    print(f"  {'and the square of its velocity':48} {shown(mirror.errors(with_velocity))}")
    print("the last of these by band")
    for low, high in BANDS_HZ:
        hz = LINES * RATE_HZ / PERIOD
        print(f"  {f'{low} to {high} Hz':48} {shown(mirror.errors(with_velocity, (hz >= low) & (hz < high)))}")


if __name__ == "__main__":
    main()
