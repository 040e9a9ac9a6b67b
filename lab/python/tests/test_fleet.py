"""The example for many actuators, on a local cluster: 200 recordings of which ten actuators differ and six files are broken; interrupted and resumed."""

import importlib.util
import os
import pathlib
import re
import tempfile
import unittest

os.environ["RAYON_NUM_THREADS"] = "1"

import numpy as np
import pandas as pd
from dask.distributed import Client, LocalCluster

HERE = pathlib.Path(__file__).resolve().parent
specification = importlib.util.spec_from_file_location("fleet", HERE.parent / "examples" / "fleet.py")
fleet = importlib.util.module_from_spec(specification)
specification.loader.exec_module(fleet)

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
    return np.column_stack([t, u, np.array(y)])


def text(rows):
    return "t_s,u_v,y_um\n" + "".join(f"{t:.4f},{u:.6f},{y:.6f}\n" for t, u, y in rows)


class Fleet(unittest.TestCase):
    def test_two_hundred_actuators(self):
        rng = np.random.default_rng(7)
        unlike = {17: {"gain": 0.75}, 58: {"gain": 1.3}, 99: {"gain": 0.8}, 23: {"lag": 2.0}, 77: {"lag": 0.5}, 140: {"lag": 2.5}}
        unlike |= {number: {"creep": 0.05} for number in (31, 64, 121, 188)}
        with tempfile.TemporaryDirectory() as kept:
            folder, out = pathlib.Path(kept, "recordings"), pathlib.Path(kept, "out")
            folder.mkdir()
            out.mkdir()
            for number in range(200):
                usual = {"gain": 1.0 + 0.01 * rng.standard_normal(), "lag": 1.0 + 0.01 * rng.standard_normal()}
                rows = recording(rng, **{**usual, **unlike.get(number, {})})
                broken = {5: "", 42: "nothing but words\n", 73: re.sub("\n0.5000,[^,]*", "\n0.5000,NaN", text(rows)), 111: text(rows)[:800]}
                broken |= {150: text(rows * [1, 1, 0]), 199: text(rows).replace("y_um", "y [turns]")}
                (folder / f"{number:03}.csv").write_text(broken.get(number, text(rows)))
            names = {f"{number:03}.csv" for number in broken}
            recordings, file = fleet.recordings_in(folder), out / "fleet.parquet"
            self.assertEqual(len(recordings), 200)
            with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster, Client(cluster) as client:
                begun = fleet.run(client, recordings[:60], START, file)
                table = fleet.run(client, recordings, START, file)
            self.assertEqual(list(table["recording"]), [path.name for path in recordings])
            # What was there is not computed again: to the last digit of the time that it took.
            again = table[table["recording"].isin(begun["recording"])].reset_index(drop=True)
            self.assertEqual(list(again["seconds"]), list(begun["seconds"]))
            pd.testing.assert_frame_equal(pd.read_parquet(file), table, check_dtype=False)

            self.assertEqual(set(table[table["error"].notna()]["recording"]), names)
            for _, row in table[table["error"].notna()].iterrows():
                self.assertIn(row["recording"], row["error"])
                self.assertTrue(pd.isna(row["verdict"]))
            gains = table.set_index("recording")["gain.gain_um_v"]
            self.assertAlmostEqual(gains["017.csv"], 0.075, delta=0.0005)
            self.assertAlmostEqual(gains.median(), 0.1, delta=0.001)

            differing = fleet.differing(table)
            expected = {f"{number:03}.csv" for number in unlike}
            self.assertLessEqual(expected, set(differing), differing)
            self.assertLessEqual(len(set(differing) - expected), 4, differing)
            for number in (31, 64, 121, 188):
                self.assertIn("creep", table.set_index("recording").at[f"{number:03}.csv", "effects"])
            page = fleet.page(table)
            for name in expected | names:
                self.assertIn(name, page)
            if "FLEET_PAGE" in os.environ:
                pathlib.Path(os.environ["FLEET_PAGE"]).write_text(page)


if __name__ == "__main__":
    unittest.main()
