"""Who names the hidden effect? Planted cases and altered real recordings, given to general methods and to Hysteron: see README.md beside this file."""

import argparse
import json
import pathlib
import subprocess
import time
import tomllib
import warnings

import numpy as np
import pandas

import methods
from terms import MEANS, terms

ROWS = 12_000


def records(folder, series):
    """Records of a data set with what the nominal model leaves of them."""
    with open(folder / "dataset.toml", "rb") as file:
        manifest = tomllib.load(file)
    for record in manifest["record"]:
        yield record, pandas.read_csv(series / (pathlib.Path(record["file"]).stem + ".csv"))


def of_its_own(record, model, t_s):
    """What a record has of its own: a constant, and where it begins anywhere what creep was doing there. It is not in the residual, so that it is
    taken out of the terms too."""
    columns = [np.ones_like(t_s)]
    if record["initial_state"] == "unknown":
        with open(model, "rb") as file:
            effects = tomllib.load(file)["effect"]
        times_s = [value["value"] for effect in effects if effect["id"] == "creep" for value in effect["parameter"] if value["unit"] == "s"]
        columns += [np.exp(-(t_s - t_s[0]) / time_s) for time_s in times_s]
    return np.linalg.qr(np.column_stack(columns))[0]


def rows(folder, series, model, role, scale):
    """All terms and the residual on the records of a role, as many samples of each, without what a record has of its own."""
    tables = [(record, table) for record, table in records(folder, series) if record["role"] == role]
    columns, residuals = [], []
    for record, table in tables:
        force = table["force_n"].to_numpy() if "force_n" in table else None
        found = terms(table["t_s"].to_numpy(), table["u_v"].to_numpy(), table["modelled_um"].to_numpy(), force)
        matrix = np.column_stack([found[name] for name in MEANS])
        own, left = of_its_own(record, model, table["t_s"].to_numpy()), table["modelled_residual_um"].to_numpy()
        matrix, left = matrix - own @ (own.T @ matrix), left - own @ (own.T @ left)
        stride = max(1, len(table) * len(tables) // ROWS)
        columns.append(matrix[::stride])
        residuals.append(left[::stride])
    matrix = np.vstack(columns)
    if scale is None:
        scale = matrix.std(axis=0)
        scale[scale == 0.0] = 1.0
    return {"terms": matrix / scale, "residual": np.concatenate(residuals)}, scale


def planted_cases(program, planted, out):
    for truth in json.loads((planted / "truth.json").read_text()):
        folder = planted / truth["name"]
        model, series = out / f"{truth['name']}.toml", out / truth["name"]
        base = ",".join((folder / "base_effects.txt").read_text().split())
        call = [program, "identify", folder, "--effects", base, "--out", model, "--series", series, "--force"]
        subprocess.run(call, check=True, capture_output=True)
        hidden = truth["hidden"]
        right = [] if hidden is None or hidden.startswith("outside") else [hidden, *truth["also"]]
        yield "planted", truth["name"], hidden or "nothing", right, folder, model, series


def altered_cases(program, altered, out):
    model = altered / "clean_model.toml"
    for line in (altered / "right.txt").read_text().splitlines():
        name, _, right = line.partition(" ")
        folder, series = altered / name, out / name
        subprocess.run([program, "compare", model, folder, "--series", series, "--force"], check=True, capture_output=True)
        yield "altered", name, right or "nothing", [one for one in right.split(",") if one], folder, model, series


def judged(groups, right):
    """Whether the first name is right, whether any is, and how many are false."""
    hit = [any(effect in right for effect in group) for group in groups]
    if not right:
        return {"first": not groups, "any": not groups, "false": len(groups)}
    return {"first": bool(hit) and hit[0], "any": any(hit), "false": hit.count(False)}


def table(results):
    lines = ["| data | method | first name right | a name right | false names | median CPU s | worst CPU s |", "|---|---|---|---|---|---|---|"]
    for data in dict.fromkeys(one["data"] for one in results):
        for method in dict.fromkeys(one["method"] for one in results):
            of = [one for one in results if one["data"] == data and one["method"] == method]
            seconds = sorted(one["seconds"] for one in of)
            count = lambda key: sum(one[key] for one in of)
            lines.append(
                f"| {data} | {method} | {count('first')} of {len(of)} | {count('any')} of {len(of)} | {count('false')} "
                f"| {float(np.median(seconds)):.1f} | {seconds[-1]:.1f} |"
            )
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--hysteron", required=True, help="the program")
    parser.add_argument("--planted", type=pathlib.Path, help="a folder of planted cases with truth.json")
    parser.add_argument("--altered", type=pathlib.Path, help="a folder that `altered_recordings --write` has written")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="a folder for models, residuals and results.json")
    parser.add_argument("--only", action="append", help="a method by its name in methods.py; all without it")
    given = parser.parse_args()
    wanted = lambda method: given.only is None or method in given.only
    warnings.filterwarnings("ignore")
    given.out.mkdir(parents=True, exist_ok=True)
    results = []
    cases = [] if given.planted is None else [planted_cases(given.hysteron, given.planted, given.out)]
    cases += [] if given.altered is None else [altered_cases(given.hysteron, given.altered, given.out)]
    for data, name, hidden, right, folder, model, series in (case for several in cases for case in several):
        fitted, scale = rows(folder, series, model, "identify", None)
        held_out, _ = rows(folder, series, model, "validate", scale)
        before = len(results)
        for method, pick in methods.GENERAL.items():
            if not wanted(method):
                continue
            begin = time.process_time()
            groups = methods.named(pick(fitted, held_out), fitted, held_out)
            seconds = time.process_time() - begin
            results.append({"data": data, "case": name, "hidden": hidden, "method": method, "named": groups, "seconds": seconds} | judged(groups, right))
        if wanted("Hysteron"):
            groups, seconds = methods.hysteron(given.hysteron, model, folder, given.out / f"{name}_diagnosis.json")
            results.append({"data": data, "case": name, "hidden": hidden, "method": "Hysteron", "named": groups, "seconds": seconds} | judged(groups, right))
        for one in results[before:]:
            said = "; ".join(" or ".join(group) for group in one["named"]) or "nothing"
            print(f"{name:<18} {hidden:<32} {one['method']:<28} {'right' if one['first'] else 'wrong':<6} {one['seconds']:5.1f} s  {said}", flush=True)
        (given.out / "results.json").write_text(json.dumps(results, indent=1))
    print("\n" + table(results))


if __name__ == "__main__":
    main()
