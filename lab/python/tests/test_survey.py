"""A survey of forty recordings, of which four differ and two are broken: in processes, of which one is killed, and on a local Dask cluster."""

import os
import pathlib
import signal
import tempfile
import threading
import time
import unittest

import numpy as np
from dask.distributed import Client, LocalCluster

import hysteron

RATE_HZ = 1000.0
START = "gain,sensor_bandwidth"


def recording(rng, *, gain=1.0, lag=1.0, creep=0.0):
    """A rest, a sweep and two steps on a stage with a lagging sensor; creep is a slow share of the displacement."""
    t = np.arange(2400) / RATE_HZ
    moving = t - 1.0
    u = np.where(moving < 0.0, 0.0, 30.0 - 30.0 * np.cos(2 * np.pi * (6.0 + 8.0 * moving) * moving) * np.where(moving > 0.7, 0.6, 1.0))
    kept = np.exp(-2 * np.pi * 80.0 / lag / RATE_HZ)
    slow, read, y = 0.0, 0.0, []
    for volts in u:
        y.append(read + 1e-3 * rng.standard_normal())
        moved = 0.1 * gain * volts
        slow += (creep * moved - slow) / (0.25 * RATE_HZ)
        read = kept * read + (1.0 - kept) * (moved + slow)
    return "t_s,u_v,y_um\n" + "".join(f"{t:.4f},{u:.6f},{y:.6f}\n" for t, u, y in zip(t, u, y))


def workers():
    """The processes that this one has started for work."""
    found = []
    for stat in pathlib.Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = stat.read_text().rsplit(")", 1)[1].split()[1]
            line = (stat.parent / "cmdline").read_text()
        except OSError:
            continue
        if parent == str(os.getpid()) and "spawn_main" in line:
            found.append(int(stat.parent.name))
    return found


def kills_a_worker():
    """Ends one of them once it is there."""
    for _ in range(2000):
        if there := workers():
            time.sleep(0.5)
            os.kill(there[0], signal.SIGKILL)
            return
        time.sleep(0.01)


class SurveyTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.kept = tempfile.TemporaryDirectory()
        cls.folder = pathlib.Path(cls.kept.name, "recordings")
        cls.folder.mkdir()
        rng = np.random.default_rng(7)
        cls.unlike = {7: {"gain": 0.75}, 18: {"gain": 1.3}, 23: {"lag": 2.0}, 31: {"creep": 0.05}}
        broken = {5: "", 33: "nothing but words\n"}
        for number in range(40):
            usual = {"gain": 1.0 + 0.01 * rng.standard_normal(), "lag": 1.0 + 0.01 * rng.standard_normal()}
            text = recording(rng, **{**usual, **cls.unlike.get(number, {})})
            (cls.folder / f"{number:03}.csv").write_text(broken.get(number, text))
        cls.broken = {f"{number:03}.csv" for number in broken}

    @classmethod
    def tearDownClass(cls):
        cls.kept.cleanup()

    def judge(self, found):
        self.assertEqual([row["recording"] for row in found.rows], [f"{number:03}.csv" for number in range(40)])
        self.assertEqual({row["recording"] for row in found.rows if row.get("error")}, self.broken)
        expected = {f"{number:03}.csv" for number in self.unlike}
        self.assertLessEqual(expected, set(found.outliers), found.outliers)
        self.assertLessEqual(len(set(found.outliers) - expected), 2, found.outliers)
        for name in expected | self.broken:
            self.assertIn(name, found.html())

    def test_a_killed_process_loses_nothing_and_a_survey_goes_on(self):
        results = pathlib.Path(self.kept.name, "rows.jsonl")
        killer = threading.Thread(target=kills_a_worker)
        killer.start()
        first = hysteron.survey(self.folder, start=START, workers=2, results=results)
        killer.join()
        self.judge(first)
        # A line was cut off: that recording alone is explained again.
        text = results.read_text()
        results.write_text(text[:-60])
        done = []
        self.judge(hysteron.survey(self.folder, start=START, results=results, progress=done.append))
        self.assertEqual(len(done), 1)

    def test_a_cluster_gives_the_same_rows(self):
        paths = sorted(self.folder.iterdir())[:8]
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
            found = hysteron.survey(paths, client, start=START)
        here = hysteron.survey(paths, start=START, workers=1)

        def timeless(rows):
            return [{key: value for key, value in row.items() if key != "seconds"} for row in rows]

        self.assertEqual(timeless(found.rows), timeless(here.rows))


if __name__ == "__main__":
    unittest.main()
