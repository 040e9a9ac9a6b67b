#!/usr/bin/env python3
"""Runs `hysteron explain` on public benchmarks of system identification and prints its error beside published ones.

    python3 benchmarks/public/run.py --hysteron target/release/hysteron --data FOLDER [--out results] [SET..]

FOLDER holds a folder for each set (README.md says which files). Sets that are not there are named and left out. Only the standard library is needed.
"""

import argparse
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
        "published": [],
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
    parser.add_argument("sets", nargs="*", metavar="SET", help=", ".join(SETS))
    said = parser.parse_args()
    unknown = [name for name in said.sets if name not in SETS]
    if unknown:
        parser.error(f"{unknown[0]}: no such set; expected {', '.join(SETS)}")
    said.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for name in said.sets or SETS:
        known = SETS[name]
        files = [said.data / name / file for file in known["train"]]
        missing = [file for file in files if not file.exists()]
        if missing:
            print(f"{name}: {missing[0]} is not there, left out (benchmarks/public/README.md says where it comes from)")
            continue
        rows += [explained(said.hysteron, name, file, known, said.out) for file in files]
    (said.out / "results.json").write_text(json.dumps(rows, indent=1) + "\n")
    for row in rows:
        figures = ", ".join(f"{value:.3g}" for value in row["held_out"])
        print(f"\n{row['set']}, {row['file']}: {row['verdict']}; {row['parameters']} parameters, {row['seconds']:.0f} s")
        print(f"  named:    {', '.join(row['named']) or 'nothing'}   (model: {', '.join(row['effects'])})")
        print(f"  held out: {figures or '-'} {row['unit']} RMS; fitted {', '.join(f'{value:.3g}' for value in row['fitted'])}")
        for test, values in row["test"].items():
            print(f"  {test}: {', '.join(f'{value:.3g}' for value in values)} {row['unit']} RMS")
        for what, error, reference in SETS[row["set"]]["published"]:
            print(f"  {what}: {error:.3g} {row['unit']} ({reference})")


if __name__ == "__main__":
    main()
