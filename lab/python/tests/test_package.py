"""The installed package: the same figures as the program, bit for bit; arrays in and out; the README's code.

`cargo xtask python` installs the wheel into a fresh virtual environment and runs this there; HYSTERON names the program.
"""

import json
import math
import os
import pathlib
import re
import signal
import subprocess
import tempfile
import threading
import tomllib
import unittest

import numpy as np

import hysteron

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[2]
EXAMPLE = ROOT / "examples" / "hidden_effect"
START = "hysteresis,initial_curve,vibration"


def program(*arguments):
    """Runs the program of this checkout."""
    subprocess.run([os.environ["HYSTERON"], *map(str, arguments)], check=True, stdout=subprocess.DEVNULL)


def timeless(figures):
    """Figures without the time that they took, which differs."""
    return {key: value for key, value in figures.items() if key != "seconds"}


class Package(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.kept = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.kept.name)
        cls.dataset = hysteron.load(EXAMPLE)
        cls.steps = []
        cls.result = hysteron.explain(cls.dataset, START, progress=cls.steps.append)
        program("explain", EXAMPLE, "--from", START, "--json", cls.folder / "explain.json", "--out", cls.folder / "model.toml")

    @classmethod
    def tearDownClass(cls):
        cls.kept.cleanup()

    def same(self, figures, file):
        self.assertEqual(timeless(figures), timeless(json.loads((self.folder / file).read_text())))

    def test_explain_is_the_programs_bit_for_bit(self):
        self.same(self.result.figures, "explain.json")
        self.assertEqual(self.result.verdict, "named")
        self.assertEqual(self.result.named, ["creep"])
        self.assertIn("Creep is missing", self.result.sentence)
        self.assertTrue(any("creep" in step for step in self.steps))
        self.result.model.save(self.folder / "saved.toml")
        self.assertEqual((self.folder / "saved.toml").read_bytes(), (self.folder / "model.toml").read_bytes())

    def test_arrays_give_the_same_as_the_files_that_hold_them(self):
        low, high = self.dataset.drive_limits_v
        arrays = hysteron.Dataset(
            self.dataset.records, name=self.dataset.name, drive_min_v=low, drive_max_v=high,
            sensor_bandwidth_hz=self.dataset.sensor_bandwidth_hz, sensor_lsb_um=self.dataset.sensor_lsb_um,
        )
        # What the arrays hold is what NumPy reads of the files.
        manifest = tomllib.loads((EXAMPLE / "dataset.toml").read_text())
        for entry, record in zip(manifest["record"], self.dataset.records, strict=True):
            _, u, y = np.loadtxt(EXAMPLE / entry["file"], delimiter=",", skiprows=1, unpack=True)
            np.testing.assert_array_equal(record.drive_v, u)
            np.testing.assert_array_equal(record.displacement_um, y)
            for key in ("role", "initial_state", "sample_rate_hz"):
                self.assertEqual(getattr(record, key), entry[key])
            self.assertEqual(record.window[0], round(entry.get("from_s", 0.0) * record.sample_rate_hz))
        # Arrays come from no file: a replay has the name of its record.
        expected = json.loads((self.folder / "explain.json").read_text())
        for replay in expected["replays"]:
            replay["file"] = pathlib.Path(replay["file"]).stem
        self.assertEqual(timeless(hysteron.explain(arrays, START).figures), timeless(expected))

    def test_what_is_said_about_a_file_is_heeded_as_the_program_does(self):
        file, model = self.folder / "columns.csv", self.folder / "said.toml"
        record = next(r for r in self.dataset.records if r.role == "validate")
        # In mV and nm, in an order of its own, at a rate that only its reader knows.
        np.savetxt(file, np.column_stack([1e3 * record.displacement_um, 1e3 * record.drive_v]), fmt="%.9e", delimiter=";")
        program(
            "identify", file, "--effects", "hysteresis", "--columns", "u=2,y=1", "--units", "u=mV,y=nm",
            "--sample-rate-hz", record.sample_rate_hz, "--out", model, "--json", self.folder / "said.json",
        )
        said = hysteron.load(file, columns={"u": 2, "y": 1}, units={"u": "mV", "y": "nm"}, sample_rate_hz=record.sample_rate_hz)
        fit = hysteron.identify(said, "hysteresis")
        self.same(fit.figures, "said.json")
        self.assertEqual(fit.model.to_toml(), model.read_text())
        self.assertTrue(said.notes)

    def test_an_effect_of_ones_own_takes_part_as_with_the_program(self):
        own = ROOT / "examples" / "contact.toml"
        program("identify", EXAMPLE, "--effects", f"hysteresis,{own}", "--json", self.folder / "own.json")
        self.same(hysteron.identify(self.dataset, ["hysteresis", own]).figures, "own.json")

    def test_a_recorded_signal_takes_part_as_with_the_program(self):
        record = next(r for r in self.dataset.records if r.role == "validate")
        samples = len(record.drive_v)
        temperature = 22.0 + np.linspace(0.0, 1.0, samples)
        own, file = self.folder / "warm.toml", self.folder / "warm.csv"
        own.write_text(
            'id = "warm"\nplace = "drift"\nauxiliary = ["temperature_c"]\noutput = "x + um_per_k * (temperature_c - 22)"\n'
            '[[parameter]]\nname = "um_per_k"\nunit = "um/K"\nlower = -10.0\nupper = 10.0\nstarts = [0.01]\n'
        )
        columns = [np.arange(samples) / record.sample_rate_hz, record.drive_v, record.displacement_um + 0.2 * (temperature - 22.0), temperature]
        np.savetxt(file, np.column_stack(columns), fmt="%.9e", delimiter=",", header="t,u,y,chamber", comments="")
        program("identify", file, "--effects", f"hysteresis,{own}", "--auxiliary", "temperature_c=chamber", "--json", self.folder / "warm.json")
        loaded = hysteron.load(file, auxiliary={"temperature_c": "chamber"})
        fit = hysteron.identify(loaded, ["hysteresis", own])
        self.same(fit.figures, "warm.json")
        # Handed over as arrays, and into a simulation, it is the same signal.
        again = hysteron.Dataset(loaded.records, name=loaded.name)
        np.testing.assert_array_equal(again.records[-1].auxiliary["temperature_c"], loaded.records[-1].auxiliary["temperature_c"])
        rate = loaded.records[-1].sample_rate_hz
        self.assertRaises(hysteron.HysteronError, lambda: fit.model.simulate(np.zeros(100), rate))
        read = fit.model.simulate(np.zeros(100), rate, auxiliary={"temperature_c": np.full(100, 23.0)})
        self.assertAlmostEqual(read[-1] - fit.model.simulate(np.zeros(100), rate, auxiliary={"temperature_c": np.full(100, 22.0)})[-1],
                               next(p.value for p in fit.model.parameters if p.name == "um_per_k"))

    def test_identify_add_compare_and_diagnose_are_the_programs(self):
        start, better = self.folder / "start.toml", self.folder / "better.toml"
        program("identify", EXAMPLE, "--effects", START, "--out", start, "--json", self.folder / "identify.json")
        fit = hysteron.identify(self.dataset, START.split(","))
        self.same(fit.figures, "identify.json")
        program("add", "creep", start, EXAMPLE, "--out", better, "--json", self.folder / "add.json")
        added = hysteron.add("creep", hysteron.Model.load(start), self.dataset)
        self.same(added.figures, "add.json")
        program("compare", better, EXAMPLE, "--json", self.folder / "compare.json")
        self.same(hysteron.compare(hysteron.Model.load(better), self.dataset).figures, "compare.json")
        program("diagnose", start, EXAMPLE, "--json", self.folder / "diagnose.json")
        self.same(hysteron.diagnose(hysteron.Model.load(start), self.dataset).figures["diagnosis"], "diagnose.json")

    def test_a_model_simulates_what_its_residual_says(self):
        record = next(r for r in self.dataset.records if r.role == "validate")
        model, residual = self.result.model, self.result.residual(record.name)
        modelled = model.simulate(record.drive_v, record.sample_rate_hz)
        again = hysteron.Model.load(self.folder / "model.toml")
        np.testing.assert_array_equal(again.simulate(record.drive_v, record.sample_rate_hz), modelled)
        self.assertEqual(modelled.dtype, np.float64)
        self.assertEqual(len(residual), len(modelled))
        apart = (np.asarray(record.displacement_um) - modelled) - residual
        self.assertLess(np.ptp(apart), 1e-9, "they differ by no more than the record's own constant")
        rms = next(r["rms_um"] for r in self.result.figures["records"] if r["file"].startswith(record.name))
        self.assertAlmostEqual(float(np.sqrt(np.mean(residual**2))), rms, places=12)

    def test_a_notebook_shows_the_page(self):
        shown = self.result._repr_html_()
        self.assertRegex(shown, '^<iframe srcdoc="[^"]*" [^<]*></iframe>$')
        self.assertIn("Creep is missing", shown)
        # But for the line that says what made it, the page is the program's.
        program("explain", EXAMPLE, "--from", START, "--report", self.folder / "program.html")
        self.result.save_report(self.folder / "package.html")
        pages = [re.split("(?=<)", (self.folder / f"{maker}.html").read_text()) for maker in ("program", "package")]
        apart = [pieces for pieces in zip(*pages, strict=True) if pieces[0] != pieces[1]]
        self.assertLessEqual(len(apart), 1, apart)

    def test_a_servo_is_the_programs(self):
        servo = hysteron.design(hysteron.Model.load(self.folder / "model.toml"), reference_hz=50.0)
        program("design", self.folder / "model.toml", "--reference-hz", "50", "--out", self.folder / "servo.toml")
        self.assertEqual(servo.toml, (self.folder / "servo.toml").read_text())
        self.assertTrue(servo.explanation)

    def test_the_lag_of_a_sensor_is_undone_as_the_program_does(self):
        model = hysteron.Model.load(self.folder / "model.toml")
        late = hysteron.design(model, sensor_bandwidth_hz=10_000.0)
        program("design", self.folder / "model.toml", "--sensor-bandwidth-hz", "10000", "--out", self.folder / "late.toml")
        self.assertEqual(late.toml, (self.folder / "late.toml").read_text())
        self.assertAlmostEqual(late.figures["sensor_lag_s"], 1 / (2 * math.pi * 10_000.0))
        with self.assertRaisesRegex(hysteron.HysteronError, "sensor-bandwidth-hz 50; expected at least 160"):
            hysteron.design(model, sensor_bandwidth_hz=50.0)

    def test_wrong_input_is_said(self):
        sine = np.sin(np.arange(100.0))

        def data(u, y, rate_hz=1e3, **more):
            return hysteron.Dataset([hysteron.Record("a", rate_hz, u, y, **more)])

        for wrong, words in [
            (lambda: hysteron.load("nowhere.csv"), "nowhere.csv: does not exist"),
            (lambda: hysteron.load(EXAMPLE, units={"v": "mV"}), "units: `v`; expected t, u, y or force"),
            (lambda: hysteron.explain([]), "there are none"),
            (lambda: hysteron.identify(self.dataset, "crepe"), "did you mean `creep`"),
            (lambda: hysteron.identify(self.dataset, []), "none are given"),
            (lambda: hysteron.identify(self.dataset, "nowhere.toml"), "nowhere.toml: cannot be read"),
            (lambda: hysteron.add("creep,delay", self.result.model, self.dataset), "expected one"),
            (lambda: hysteron.add("creep", self.result.model, self.dataset), "is in the model already"),
            (lambda: data(sine, sine[:50]), "a: the drive has 100 samples, the displacement 50"),
            (lambda: data(sine, sine, role="fitted"), "a: role = \"fitted\"; expected identify, validate, noise or test"),
            (lambda: data(sine, sine, initial_state="new"), "a: initial_state = \"new\"; expected virgin or settled or unknown"),
            (lambda: data(sine, sine, offset="none"), "a: offset = \"none\"; expected fit or zero"),
            (lambda: data(sine, sine, window=(50, 500)), "a: the window 50..500 is not inside the 100 samples"),
            (lambda: data(sine, sine, repeat_of="b"), "names no record"),
            (lambda: data(sine, sine, rate_hz=-1.0), "expected a positive number"),
            (lambda: data(sine, sine, rate_hz=math.inf), "expected a positive number"),
            (lambda: data(sine.reshape(2, 50), sine), "a: drive_v: has the shape (2, 50); expected one dimension"),
            (lambda: data(sine, 1j * sine), "a: displacement_um: complex numbers; expected real numbers"),
            (lambda: data(["x"] * 100, sine), "a: drive_v: could not convert"),
            (lambda: data([], []), "records: there are none with samples"),
            (lambda: data(np.full(100, np.nan), sine), "a: sample 1: drive NaN; expected a finite number"),
            (lambda: hysteron.Model.load("nowhere.toml"), "nowhere.toml: cannot be read"),
            (lambda: hysteron.Model.load(EXAMPLE / "dataset.toml"), "dataset.toml"),
            (lambda: self.result.model.simulate([1e6], 1e3), "drive_v: reaches 1000000 V; the model holds from 0 to"),
            (lambda: self.result.model.simulate([1.0, math.nan], 1e3), "drive_v: reaches NaN V"),
            (lambda: self.result.model.simulate([1.0], 0.0), "sample_rate_hz = 0; expected a positive number"),
            (lambda: self.result.model.simulate([1.0], 1e3, force_n=[1.0, 2.0]), "expected as many"),
            (lambda: self.result.model.simulate([1.0], 1e3, initial_state="unknown"), "expected virgin or settled"),
            (lambda: self.result.residual("nobody"), "record `nobody`: expected one of"),
            (lambda: self.result.residual(-1), "record -1: expected 0 to"),
        ]:
            with self.subTest(words), self.assertRaisesRegex(hysteron.HysteronError, re.escape(words)):
                wrong()

    def test_what_progress_raises_ends_the_search(self):
        def impatient(step):
            raise LookupError(step)

        with self.assertRaisesRegex(LookupError, self.steps[0]):
            hysteron.explain(self.dataset, START, progress=impatient)

    def test_ctrl_c_ends_the_search(self):
        steps = []

        def interrupted(step):
            if not steps:
                signal.raise_signal(signal.SIGINT)
            steps.append(step)

        # A shell's background job ignores the signal until somebody handles it.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            with self.assertRaises(KeyboardInterrupt):
                hysteron.explain(self.dataset, START, progress=interrupted)
        finally:
            signal.signal(signal.SIGINT, before)
        self.assertLess(len(steps), len(self.steps))

    def test_other_threads_go_on_meanwhile(self):
        # A thread that counts gets on between two steps only if the search does not hold Python's lock.
        count, ended = [0], threading.Event()

        def count_on():
            while not ended.is_set():
                count[0] += 1

        counts, thread = [], threading.Thread(target=count_on)
        thread.start()
        try:
            hysteron.explain(self.dataset, START, progress=lambda _: counts.append(count[0]))
        finally:
            ended.set()
            thread.join()
        self.assertGreater(len(set(counts)), len(counts) // 2)

    def test_files_are_written_whole_or_not_at_all(self):
        for save in (self.result.model.save, self.result.save_report):
            (self.folder / "taken").mkdir(exist_ok=True)
            with self.assertRaises(OSError):
                save(self.folder / "taken")
            self.assertEqual([f.name for f in self.folder.iterdir() if "taken" in f.name], ["taken"])

    def test_the_readmes_code(self):
        blocks = re.findall(r"```python\n(.*?)```", (HERE.parent / "README.md").read_text(), re.DOTALL)
        self.assertGreaterEqual(len(blocks), 3)
        before = os.getcwd()
        os.chdir(self.folder)
        try:
            names = {}
            for block in blocks:
                exec(compile(block, "README.md", "exec"), names)
        finally:
            os.chdir(before)
        self.assertIn(names["result"].verdict, ("named", "ambiguous"))
        self.assertEqual(names["y_um"].shape, (100,))

    def test_every_public_name_is_described_and_typed(self):
        for name in hysteron.__all__:
            self.assertTrue(getattr(hysteron, name).__doc__, name)
        for kind in (hysteron.Dataset, hysteron.Explanation, hysteron.Fit, hysteron.Model, hysteron.Record, hysteron.Servo):
            for name, member in vars(kind).items():
                if not name.startswith("_") and (callable(member) or isinstance(member, (property, classmethod))):
                    self.assertTrue(member.__doc__, f"{kind.__name__}.{name}")
        native = re.findall(r"^(?:def|class) (\w+)", (HERE.parent / "hysteron" / "_native.pyi").read_text(), re.MULTILINE)
        self.assertEqual(sorted(native), sorted(n for n in dir(hysteron._native) if not n.startswith("_")))
        self.assertTrue((pathlib.Path(hysteron.__file__).parent / "py.typed").is_file())


class Loops(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        fit = hysteron.identify(hysteron.load(EXAMPLE), START + ",creep")
        cls.model, cls.servo = fit.model, hysteron.design(fit.model)

    @staticmethod
    def stage():
        """A gain behind a mode, by equations of its own; readings count from zero volts."""
        at = {"um": 0.0, "um_s": 0.0}
        rad_s, damping, gain, step_s = 2 * math.pi * 917.0, 0.51, 0.15, 5e-5 / 10

        def moves(drive_v):
            for _ in range(10):
                at["um_s"] += step_s * (rad_s**2 * (gain * drive_v - at["um"]) - 2 * damping * rad_s * at["um_s"])
                at["um"] += step_s * at["um_s"]
            return at["um"]

        return moves

    def test_a_model_and_a_function_are_plants(self):
        on_model = hysteron.track(self.servo, self.model, "sine:20:2:4")
        self.assertLess(on_model["true"]["rms_um"], 0.02)
        on_function = hysteron.track(self.servo, self.stage(), "sine:20:2:4")
        self.assertLess(on_function["true"]["rms_um"], 0.1)
        self.assertEqual(on_function["saturated_ticks"], 0)
        with self.assertRaises(ZeroDivisionError):
            hysteron.track(self.servo, lambda drive_v: 1 / 0, "sine:20:2:4")

    def test_a_servo_ticks_in_a_loop_of_ones_own(self):
        loop, moves = self.servo.loop(), self.stage()
        reading_um, drive_v = 0.0, 0.0
        for _ in range(4000):
            later_v = loop.tick(reading_um, 3.0)
            reading_um, drive_v = moves(drive_v), later_v
        self.assertAlmostEqual(reading_um, 3.0, delta=0.01)


if __name__ == "__main__":
    unittest.main()
