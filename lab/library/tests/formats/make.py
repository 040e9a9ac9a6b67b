#!/usr/bin/env python3
"""Writes files into a folder (beside this script without one), each with the library of its format: `pip install numpy scipy h5py npTDMS
pyarrow pandas openpyxl`. `cargo xtask python` does so with the libraries of the day, and the tests then read those instead of the kept ones.

All hold the same simulated recording, which `tests/formats.rs` computes again and compares; `written.rs` lists what each file is.
"""
import csv
import decimal
import pathlib
import sys
import h5py
import nptdms
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet as pq
import scipy.io
import scipy.io.wavfile

here = pathlib.Path(sys.argv[1]) if len(sys.argv) > 1 else pathlib.Path(__file__).parent
rate_hz = 2000.0
k = np.arange(160)
drive = lambda k: 20.0 - 20.0 * np.cos(0.1 * k) * (1.0 - 0.002 * k)
t, u, y = k / rate_hz, drive(k), 0.25 * drive(k - 2.0) + 0.01 * np.sin(7.0 * k)

# NumPy
np.save(here / "columns.npy", np.column_stack([t, u, y]))
np.save(here / "single_rows.npy", np.asfortranarray(np.vstack([t, u, y]).astype(np.float32)))
np.savez(here / "arrays.npz", t_s=t, u_v=u, y_um=y, fs=rate_hz)
np.savez_compressed(here / "compressed.npz", t_s=t, u_mv=np.round(u * 1e3).astype(np.int32), y_nm=y * 1e3)

# MATLAB 5
scipy.io.savemat(here / "vectors.mat", {"t": t, "u": u, "y": y}, oned_as="column")
scipy.io.savemat(here / "compressed.mat", {"record": np.column_stack([t, u, y])}, do_compression=True)
signals = np.empty((1, 2), dtype=[("values", object), ("label", object), ("dimensions", object)])
signals[0, 0] = (u[:, None], "u [V]", 1.0)
signals[0, 1] = (y[:, None], "y [um]", 1.0)
scipy.io.savemat(here / "simulink.mat", {"out": {"time": t[:, None], "signals": signals, "blockName": "stage/Scope"}}, do_compression=True)
channels = np.empty((1, 2), dtype=[("Name", object), ("Unit", object), ("Data", object)])
channels[0, 0] = ("Platform()://Model/Drive", "V", u.astype(np.float32)[None, :])
channels[0, 1] = ("Platform()://Model/Position", "nm", 1e3 * y[None, :])
scipy.io.savemat(here / "controldesk.mat", {"exp_001": {"X": {"Name": "Time", "Unit": "s", "Data": t[None, :]}, "Y": channels, "Description": "rec"}})
cells = np.empty((1, 3), dtype=object)
cells[0, 0], cells[0, 1], cells[0, 2] = t, u, y
scipy.io.savemat(here / "cells.mat", {"log": cells, "dt": 1 / rate_hz})

# HDF5, plain and as MATLAB 7.3 lays it out
with h5py.File(here / "groups.h5", "w") as f:
    run = f.create_group("run 1")
    run.create_dataset("time", data=t).attrs["units"] = "s"
    run.create_dataset("drive", data=u, chunks=(64,), compression="gzip", shuffle=True).attrs["units"] = "V"
    run.create_dataset("position", data=(1e3 * y).astype(">f4")).attrs["units"] = "nm"
    f.attrs["comment"] = "simulated"
with h5py.File(here / "table.h5", "w") as f:
    f.create_dataset("data", data=np.column_stack([t, u, y]), chunks=(50, 3), compression="gzip", fletcher32=True)
with h5py.File(here / "rate_of_file.h5", "w") as f:
    f.attrs["sample_rate_hz"] = rate_hz
    f["drive"], f["position"] = u, y
with h5py.File(here / "rate_of_group.h5", "w") as f:
    run = f.create_group("run 1")
    run.attrs["fs"] = int(rate_hz)
    run["drive"], run["position"] = u, y
with h5py.File(here / "period_of_dataset.h5", "w") as f:
    for name, values in (("drive", u), ("position", y)):
        f.create_dataset(name, data=values).attrs["dt"] = 1 / rate_hz
with h5py.File(here / "matlab73.mat", "w", userblock_size=512) as f:
    refs = f.create_group("#refs#")
    def text(group, name, value):
        made = group.create_dataset(name, data=np.array([[ord(c)] for c in value], dtype=np.uint16))
        made.attrs["MATLAB_class"] = np.bytes_("char")
        return made
    def numbers(group, name, values):
        made = group.create_dataset(name, data=np.asarray(values, dtype=float).reshape(1, -1))
        made.attrs["MATLAB_class"] = np.bytes_("double")
        return made
    out = f.create_group("out")
    out.attrs["MATLAB_class"] = np.bytes_("struct")
    numbers(out, "time", t)
    array = out.create_group("signals")
    array.attrs["MATLAB_class"] = np.bytes_("struct")
    values = [numbers(refs, "a", u), numbers(refs, "b", y)]
    labels = [text(refs, "c", "u [V]"), text(refs, "d", "y [um]")]
    for name, made in (("values", values), ("label", labels)):
        array.create_dataset(name, data=np.array([[m.ref] for m in made], dtype=h5py.ref_dtype))
with open(here / "matlab73.mat", "r+b") as f:
    f.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64, simulated".ljust(124) + b"\x00\x02IM")

# TDMS
def channel(name, values, unit, **more):
    return nptdms.ChannelObject("record", name, values, properties={"unit_string": unit, **more})
with nptdms.TdmsWriter(here / "waveforms.tdms") as writer:
    step = {"wf_increment": 1 / rate_hz, "wf_start_offset": 0.0}
    for part in (slice(0, 100), slice(100, 160)):
        writer.write_segment([channel("drive", u[part], "V", **step), channel("position", y[part], "um", **step)])
with nptdms.TdmsWriter(here / "with_time.tdms") as writer:
    writer.write_segment([channel("Time", t, "s"), channel("AO0", u.astype(np.float32), "V"), channel("AI0", (y * 1e6).astype(np.int32), "pm")])

# Parquet
frame = pd.DataFrame({"t_s": t, "u_v": u, "y_um": y.astype(np.float32), "comment": ["simulated"] * len(t)})
frame.to_parquet(here / "frame.parquet", index=False)
stamped = pa.table({"timestamp": pa.array(np.datetime64("2026-01-01", "us") + (t * 1e6).astype("timedelta64[us]")), "u_mv": (u * 1e3).round().astype(np.int64), "y_um": y})
pq.write_table(stamped, here / "stamped.parquet", compression="gzip", row_group_size=100)
pq.write_table(stamped, here / "zstd.parquet", compression="zstd")
pq.write_table(stamped, here / "second_pages.parquet", compression="zstd", data_page_version="2.0", data_page_size=400)
decimals = pa.table({"t_s": t, "u_v": pa.array([decimal.Decimal(f"{v:.6f}") for v in u], pa.decimal128(12, 6)), "y_um": y})
pq.write_table(decimals, here / "decimals.parquet", store_decimal_as_integer=True)
pq.write_table(stamped, here / "lz4.parquet", compression="lz4")
pq.write_table(stamped, here / "brotli.parquet", compression="brotli")

# Feather, Arrow
frame.to_feather(here / "frame.feather", compression="lz4")
with pa.ipc.new_file(here / "batches.arrow", stamped.schema) as file:
    file.write_table(stamped, max_chunksize=100)
pyarrow.feather.write_feather(stamped, here / "zstd.feather", compression="zstd")

# Spreadsheet
with pd.ExcelWriter(here / "book.xlsx") as book:
    pd.DataFrame({"about": ["a simulated stage"]}).to_excel(book, sheet_name="about", index=False)
    pd.DataFrame({"t [ms]": 1e3 * t, "u [V]": u, "y [um]": y}).to_excel(book, sheet_name="record", index=False)

# WAV
scipy.io.wavfile.write(here / "floats.wav", int(rate_hz), np.column_stack([u, y]).astype(np.float32))
scipy.io.wavfile.write(here / "codes.wav", int(rate_hz), np.round(np.column_stack([u / 50.0, y / 20.0]) * 32767).astype(np.int16))

# Text, in many habits
named = pd.DataFrame({"t_s": t, "u_v": u, "y_um": y})
named.to_csv(here / "comma.csv", index=False)
named.to_csv(here / "numbered_rows.csv")
named.to_csv(here / "no_header.csv", index=False, header=False)
named.to_csv(here / "quoted.csv", index=False, quoting=csv.QUOTE_ALL)
named.to_csv(here / "exponents.csv", index=False, float_format="%.9e")
named.to_csv(here / "byte_order_mark.csv", index=False, encoding="utf-8-sig", lineterminator="\r\n")
named.to_csv(here / "tabs.txt", index=False, sep="\t", encoding="utf-16")
(here / "aligned.txt").write_text(named.to_string(index=False) + "\n")
german = pd.DataFrame({"Zeit [s]": t, "Spannung [V]": u, "Weg [\u00b5m]": y})
german.to_csv(here / "decimal_commas.csv", index=False, sep=";", decimal=",", encoding="latin-1")
two_lines = pd.DataFrame(np.column_stack([1e3 * t, 1e3 * u, 1e3 * y]), columns=pd.MultiIndex.from_tuples([("time", "ms"), ("drive", "mV"), ("position", "nm")]))
two_lines.to_csv(here / "units_in_second_line.csv", index=False)
clock = pd.DataFrame({"time": pd.Timestamp("2026-01-01 12:59:59.95") + pd.to_timedelta(t, unit="s"), "u_v": u, "y_um": y})
clock.to_csv(here / "time_of_day.csv", index=False, date_format="%H:%M:%S.%f")
clock.to_csv(here / "date_and_time.csv", index=False, date_format="%Y-%m-%d %H:%M:%S.%f")
