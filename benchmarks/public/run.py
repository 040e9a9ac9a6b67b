#!/usr/bin/env python3
"""Runs `hysteron explain` on public benchmarks of system identification and prints its error beside published ones.

    python3 benchmarks/public/run.py --hysteron target/release/hysteron --data FOLDER [--out results] [--csv FILE] [SET..]

FOLDER holds a folder for each set (README.md says which files). Sets that are not there are named and left out. Only the standard library is needed.
"""

import argparse
import array
import csv
import json
import pathlib
import subprocess
import sys
import time

# Of each set: files to fit, files to judge once at the end, what to say of reading them, the benchmark's unit
# with its size in the program's, and published errors.
SETS = {
    "bouc_wen": {
        "train": ["train_multisine.npz"],
        "test": ["test_multisine.npz", "test_sinesweep.npz"],
        "say": ["--columns", "u=u_n,y=y_m", "--sample-rate-hz", "750"],
        "unit": ("m", 1e-6),
        "published": [
            ("noise of the training record", 8e-6, "Noel and Schoukens, hysteretic benchmark with a dynamic nonlinearity, 4TU.ResearchData, doi 10.4121/12967592"),
        ],
    },
    "silverbox": {
        "train": ["train_multisine.npz"],
        "test": ["test_multisine.npz", "test_arrow_full.npz", "test_arrow_no_extrapolation.npz"],
        "say": ["--columns", "u=input_v,y=output_v", "--sample-rate-hz", "610.3515625"],
        "unit": ("mV", 1.0),
        "published": [
            ("nonlinear models, 0.3 % of the output", 0.16, "models collected at nonlinearbenchmark.org for T. Wigren and J. Schoukens, ECC (2013) 2933-2938"),
            ("nonlinear models, 1 % of the output", 0.53, "the same"),
        ],
    },
    "friction_damper": {
        "train": ["0.5Hz20lbtension.csv", "0.5Hz30lbtension1amplitude.csv"],
        "each": True,
        "test": [],
        "say": [],
        "unit": ("N", 1.0),
        "published": [],
    },
}


MIRROR = "fine_steering_mirror"
MIRROR_RATE_HZ = 6400.0
MIRROR_PERIOD = 8192
# Errors of one model of all levels on the test records, nm: M. Floren et al., ISMA-USD (2024).
MIRROR_PUBLISHED = "86.6, 130.9 and 168.6 nm at 100, 200 and 300 mV (M. Floren et al., ISMA-USD 2024)"


def mirror_records(u_file, y_file, folder):
    """CSV files of the realisations of a level, from arrays of samples by channels by realisations by periods."""
    arrays = []
    for file in (u_file, y_file):
        content = file.read_bytes()
        if content[:6] != b"\x93NUMPY" or content[6] != 1:
            sys.exit(f"{file}: is no NPY file of version 1; expected an array of samples by 3 channels by realisations by periods")
        length = int.from_bytes(content[8:10], "little")
        header = content[10 : 10 + length].decode("latin1")
        shape = [int(size) for size in header.split("'shape':")[1].split("(")[1].split(")")[0].split(",") if size.strip()]
        if "'<f8'" not in header or "'fortran_order': False" not in header or len(shape) != 4 or shape[:2] != [MIRROR_PERIOD, 3]:
            sys.exit(f"{file}: {header.strip()}; expected 64-bit numbers, {MIRROR_PERIOD} samples by 3 channels by realisations by periods")
        values = array.array("d")
        values.frombytes(content[10 + length :])
        if sys.byteorder == "big":
            values.byteswap()
        arrays.append((shape, values))
    (shape, u), (other, y) = arrays
    if shape != other:
        sys.exit(f"{y_file}: shape {other}; expected {shape} as in {u_file.name}")
    _, channels, realisations, periods = shape
    for realisation in range(realisations):
        name = f"{u_file.stem[2:]}_{realisation + 1}.csv"
        at = lambda k, channel, period: ((k * channels + channel) * realisations + realisation) * periods + period
        with (folder / name).open("w") as opened:
            opened.write("u1,u2,u3,y1,y2,y3\n")
            for period in range(periods):
                for k in range(MIRROR_PERIOD):
                    row = [u[at(k, c, period)] for c in range(3)] + [1e6 * y[at(k, c, period)] for c in range(3)]
                    opened.write(",".join(f"{value:.9e}" for value in row) + "\n")
        yield name, realisation + 1 == realisations


def mirror(program, data, out):
    """Three drives, three sensors, all levels in one model; a row of the table, or none."""
    folder = data / MIRROR
    files = [folder / f"u_{level}mV_train.npy" for level in (100, 200, 300)]
    others = [file.with_name("y" + file.name[1:]) for file in files]
    missing = [file for file in files + others if not file.exists()]
    if missing:
        print(f"{MIRROR}: {missing[0]} is not there, left out (benchmarks/public/README.md says where it comes from)")
        return []
    (out / MIRROR).mkdir(exist_ok=True)
    text = f'name = "{MIRROR}"\n'
    for u_file, y_file in zip(files, others):
        for name, judges in mirror_records(u_file, y_file, out / MIRROR):
            text += f'\n[[record]]\nfile = "{name}"\nsample_rate_hz = {MIRROR_RATE_HZ}\nrole = "{"validate" if judges else "identify"}"\n'
            # The recordings begin in the steady state: both periods count.
            text += f"period_s = {MIRROR_PERIOD / MIRROR_RATE_HZ}\nperiodic_from_s = 0.0\n"
            text += 'columns = { u = ["u1", "u2", "u3"], y = ["y1", "y2", "y3"] }\n'
    (out / MIRROR / "dataset.toml").write_text(text)
    began = time.time()
    found = out / f"{MIRROR}.json"
    text = hysteron(program, "axes", "explain", out / MIRROR, "--out", out / f"{MIRROR}.toml", "--json", found, "--report", out / f"{MIRROR}.html", "--force")
    (out / f"{MIRROR}.txt").write_text(text)
    figures = json.loads(found.read_text())
    return [
        {
            "set": MIRROR,
            "file": ", ".join(file.name for file in files),
            "unit": "um",
            "fitted": [],
            "held_out": [sensor["held_out_rms"] for sensor in figures["sensors"]],
            "verdict": MIRROR_PUBLISHED,
            "named": [f"{effect['effect']} ({effect['channel']})" for effect in figures["named"]],
            "effects": sorted({effect["effect"] for effect in figures["named"]}),
            "parameters": figures["parameters"],
            "seconds": time.time() - began,
            "test": {},
        }
    ]


def write_csv(rows, file):
    """A line for each file and each published figure."""
    with file.open("w", newline="") as opened:
        table = csv.writer(opened, lineterminator="\n")
        table.writerow(["set", "file", "who", "held_out_rms", "fitted_rms", "unit", "named", "model", "parameters", "seconds"])
        figures = lambda values: " ".join(f"{value:.3g}" for value in values)
        for row in rows:
            ours = [figures(row["held_out"]), figures(row["fitted"]), row["unit"], " ".join(row["named"]), " ".join(row["effects"])]
            table.writerow([row["set"], row["file"], "hysteron", *ours, row["parameters"], f"{row['seconds']:.0f}"])
            for test, values in row["test"].items():
                table.writerow([row["set"], test, "hysteron", figures(values), "", row["unit"], "", "", "", ""])
        for name in dict.fromkeys(row["set"] for row in rows):
            for what, error, reference in SETS.get(name, {"published": []})["published"]:
                table.writerow([name, what, reference, f"{error:.3g}", "", SETS[name]["unit"][0], "", "", "", ""])


def hysteron(program, *arguments):
    """One run; what it prints."""
    done = subprocess.run([str(program), *map(str, arguments)], capture_output=True, text=True)
    if done.returncode not in (0, 1):
        sys.exit(f"{' '.join(map(str, arguments))}\n{done.stderr}{done.stdout}")
    return done.stdout


def errors(figures, role, size):
    return [record["rms_um"] * size for record in figures["records"] if record["role"] == role]


def explained(program, name, file, known, out):
    """Explains one file; a row of the table."""
    stem = f"{name}_{file.stem}"
    model, found = out / f"{stem}.toml", out / f"{stem}.json"
    began = time.time()
    text = hysteron(program, "explain", file, *known["say"], "--out", model, "--json", found, "--report", out / f"{stem}.html", "--force")
    seconds = time.time() - began
    (out / f"{stem}.txt").write_text(text)
    figures = json.loads(found.read_text())
    unit, size = known["unit"]
    diagnosis = figures["diagnosis"]
    row = {
        "set": name,
        "file": file.name,
        "unit": unit,
        "fitted": errors(figures, "identify", size),
        "held_out": errors(figures, "validate", size),
        "verdict": diagnosis["verdict"],
        "named": diagnosis["named"],
        "effects": figures["effects"],
        "parameters": len(figures["parameters"]),
        "seconds": seconds,
        "test": {},
    }
    for test in known["test"]:
        path = file.parent / test
        if path.exists():
            compared = out / f"{stem}_{path.stem}.json"
            hysteron(program, "compare", model, path, *known["say"], "--json", compared, "--force")
            judged = json.loads(compared.read_text())
            row["test"][test] = [record["rms_um"] * size for record in judged["records"] if record["role"] != "noise"]
    return row


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hysteron", type=pathlib.Path, default=pathlib.Path("target/release/hysteron"))
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("target/public_benchmarks"))
    parser.add_argument("--csv", type=pathlib.Path)
    every = [*SETS, MIRROR]
    parser.add_argument("sets", nargs="*", metavar="SET", help=", ".join(every))
    said = parser.parse_args()
    unknown = [name for name in said.sets if name not in every]
    if unknown:
        parser.error(f"{unknown[0]}: no such set; expected {', '.join(every)}")
    said.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in said.sets or every:
        if name == MIRROR:
            rows += mirror(said.hysteron, said.data, said.out)
            continue
        known = SETS[name]
        files = [said.data / name / file for file in known["train"]]
        missing = [file for file in files if not file.exists()]
        if missing:
            print(f"{name}: {missing[0]} is not there, left out (benchmarks/public/README.md says where it comes from)")
            continue
        rows += [explained(said.hysteron, name, file, known, said.out) for file in files]
    (said.out / "results.json").write_text(json.dumps(rows, indent=1) + "\n")
    if said.csv:
        write_csv(rows, said.csv)
    for row in rows:
        figures = ", ".join(f"{value:.3g}" for value in row["held_out"])
        print(f"\n{row['set']}, {row['file']}: {row['verdict']}; {row['parameters']} parameters, {row['seconds']:.0f} s")
        print(f"  named:    {', '.join(row['named']) or 'nothing'}   (model: {', '.join(row['effects'])})")
        print(f"  held out: {figures or '-'} {row['unit']} RMS; fitted {', '.join(f'{value:.3g}' for value in row['fitted'])}")
        for test, values in row["test"].items():
            print(f"  {test}: {', '.join(f'{value:.3g}' for value in values)} {row['unit']} RMS")
        for what, error, reference in SETS.get(row["set"], {"published": []})["published"]:
            print(f"  {what}: {error:.3g} {row['unit']} ({reference})")


if __name__ == "__main__":
    main()
