"""Many actuators: a recording of each is explained on all cores, or on a cluster, and a page shows which differ from the rest.

    pip install hysteron-piezo "dask[distributed]" pandas pyarrow
    python fleet.py RECORDINGS OUT [--start gain,sensor_bandwidth] [--scheduler tcp://HOST:8786]

RECORDINGS is a folder with a file, or a folder with ``dataset.toml``, for each actuator. OUT/fleet.parquet gets one row for each: verdict, effects,
values with standard deviations, seconds, or the error of a recording that cannot be read. It is written anew after every few rows: what is in it
is not computed again, so that work that was interrupted goes on where it stopped. OUT/fleet.html is the page.
"""

from __future__ import annotations

import argparse
import html
import os
import time
from pathlib import Path
from typing import Any, Iterator

import numpy as np
import pandas as pd
from dask.distributed import Client, LocalCluster, as_completed

import hysteron

#: Rows that may be lost when the work is interrupted.
ROWS_BETWEEN_WRITES = 20
#: A verdict, or a set of effects, that fewer than this share of the actuators have is rare.
RARE = 0.1
#: Robust standard deviations from the median at which a value stands out.
STANDS_OUT = 5.0


def explained(recording: str, start: str) -> dict[str, Any]:
    """The row of one actuator."""
    began = time.perf_counter()
    row: dict[str, Any] = {"recording": Path(recording).name, "error": None}
    try:
        result = hysteron.explain(hysteron.load(recording), start)
        row |= {"verdict": result.verdict, "named": ", ".join(result.named), "effects": ", ".join(result.model.effects)}
        row |= {"noise_um": result.noise_floor_um, "sentence": result.sentence}
        for parameter in result.model.parameters:
            name = f"{parameter.effect}.{parameter.name}"
            row |= {name: parameter.value, f"{name}.std": parameter.std}
    except hysteron.HysteronError as error:
        row["error"] = str(error)
    return row | {"seconds": time.perf_counter() - began}


def written(rows: list[dict[str, Any]], file: Path) -> pd.DataFrame:
    """Writes all rows, whole or not at all."""
    table = pd.DataFrame(rows).sort_values("recording", ignore_index=True)
    beside = file.with_suffix(".part")
    table.to_parquet(beside, index=False)
    os.replace(beside, file)
    return table


def run(client: Client, recordings: list[Path], start: str, file: Path) -> pd.DataFrame:
    """Explains what has no row yet."""
    rows = pd.read_parquet(file).to_dict("records") if file.exists() else []
    there = {row["recording"] for row in rows}
    missing = [str(recording) for recording in recordings if recording.name not in there]
    futures = client.map(explained, missing, start=start, pure=False)
    try:
        for number, (_, row) in enumerate(as_completed(futures, with_results=True), 1):
            rows.append(row)
            if number % ROWS_BETWEEN_WRITES == 0:
                written(rows, file)
                print(f"{number} of {len(missing)}", flush=True)
    finally:
        table = written(rows, file)
    return table


def columns_of_values(table: pd.DataFrame) -> Iterator[str]:
    """Values of parameters, and the noise."""
    yield "noise_um"
    yield from (name for name in table.columns if f"{name}.std" in table.columns)


def differing(table: pd.DataFrame) -> dict[str, list[str]]:
    """What is different about each actuator that differs: a verdict or effects that few have, a value far from the median."""
    good = table[table["error"].isna()]
    if good.empty:
        return {}
    found: dict[str, list[str]] = {}
    for column in ("verdict", "effects"):
        shares = good[column].value_counts(normalize=True)
        for _, row in good[good[column].map(shares) < RARE].iterrows():
            found.setdefault(row["recording"], []).append(f"{column}: {row[column]}; most have {shares.index[0]}")
    for column in columns_of_values(good):
        values = good[column].dropna()
        if len(values) < max(5, len(good) // 4):
            continue
        median = values.median()
        own = good[f"{column}.std"] if f"{column}.std" in good else pd.Series(0.0, good.index)
        spread = 1.4826 * (values - median).abs().median()
        for index, value in values.items():
            std = own[index] if np.isfinite(own[index]) else 0.0
            away = abs(value - median) / max(float(np.hypot(spread, std)), 1e-12 * abs(median), 1e-300)
            if away > STANDS_OUT:
                words = f"{column} {value:.4g}, median {median:.4g} ({away:.0f} standard deviations)"
                found.setdefault(good.at[index, "recording"], []).append(words)
    return found


def strip(table: pd.DataFrame, column: str, marked: set[str]) -> str:
    """All values of a column on a line; those of differing actuators stand out in form and colour."""
    rows = table[table[column].notna()]
    low, high = float(rows[column].min()), float(rows[column].max())
    width = high - low or abs(high) or 1.0
    marks = []
    for _, row in rows.sort_values("recording", key=lambda names: names.isin(marked)).iterrows():
        name, x = html.escape(row["recording"]), 10 + 580 * (row[column] - low) / width
        title = f"<title>{name}: {row[column]:.5g}</title>"
        if row["recording"] in marked:
            marks.append(f'<path d="M{x:.1f} 6l6 10h-12z" class="far">{title}</path>')
        else:
            marks.append(f'<circle cx="{x:.1f}" cy="22" r="4" class="usual">{title}</circle>')
    ends = f'<text x="10" y="46">{low:.4g}</text><text x="590" y="46" text-anchor="end">{high:.4g}</text>'
    return f'<h3>{html.escape(column)}</h3><svg viewBox="0 0 600 50" role="img" aria-label="{html.escape(column)}">{"".join(marks)}{ends}</svg>'


STYLE = """
:root { color-scheme: light dark; --text: #1c2128; --back: #fbfbf9; --line: #ccc; --far: #c2410c; --usual: #2563c9; }
@media (prefers-color-scheme: dark) { :root { --text: #e6e6e6; --back: #16181c; --line: #444; --far: #fb923c; --usual: #7aa7ff; } }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--text); background: var(--back); max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; width: 100%; } td, th { text-align: left; vertical-align: top; padding: 4px 12px 4px 0; border-bottom: 1px solid var(--line); }
td { overflow-wrap: anywhere; } td:first-child { white-space: nowrap; font-weight: 600; } h3 { font-size: 13px; margin: 1rem 0 0; }
svg { width: 100%; } text { font-size: 8px; fill: var(--text); } .far { fill: var(--far); } .usual { fill: var(--usual); fill-opacity: 0.35; }
"""


def page(table: pd.DataFrame) -> str:
    """Which actuators differ from the rest, and in what; one file that opens without a network."""
    found = differing(table)
    good, broken = table[table["error"].isna()], table[table["error"].notna()]

    def listed(entries: Iterator[tuple[str, str]]) -> str:
        return "".join(f"<tr><td>{html.escape(name)}</td><td>{text}</td></tr>" for name, text in entries)

    far = listed((name, "<br>".join(map(html.escape, what))) for name, what in sorted(found.items(), key=lambda entry: (-len(entry[1]), entry[0])))
    refused = listed((row["recording"], html.escape(row["error"])) for _, row in broken.iterrows())
    verdicts = ", ".join(f"{count} {verdict.replace('_', ' ')}" for verdict, count in good["verdict"].value_counts().items()) if len(good) else "none"
    strips = "".join(strip(good, column, set(found)) for column in columns_of_values(good) if good[column].notna().sum() > 4)
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Fleet</title><style>{STYLE}</style>'
        f"<h1>{len(found)} of {len(good)} actuators differ from the rest</h1>"
        f"<p>{len(table)} recordings, {len(broken)} of them unreadable. Verdicts: {html.escape(verdicts)}.</p>"
        f"<table>{far or '<tr><td>None differs.</td></tr>'}</table>"
        f'<h2>All values</h2><p>A triangle is an actuator of the list above, a disc any other.</p>{strips}'
        f"<h2>What could not be read</h2><table>{refused or '<tr><td>Nothing.</td></tr>'}</table></html>"
    )


def recordings_in(folder: Path) -> list[Path]:
    """A recording for each actuator: files, and folders with a manifest."""
    return sorted(path for path in folder.iterdir() if not path.name.startswith(".") and (path.is_file() or (path / "dataset.toml").is_file()))


def main() -> None:
    """Explains a folder of recordings."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("recordings", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--start", default="gain")
    parser.add_argument("--scheduler", help="address of a cluster; a local one without it")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    # One thread of the library in each process: the cluster has the cores.
    os.environ.setdefault("RAYON_NUM_THREADS", "1")
    cluster = arguments.scheduler or LocalCluster(threads_per_worker=1, dashboard_address=None)
    with Client(cluster) as client:
        table = run(client, recordings_in(arguments.recordings), arguments.start, arguments.out / "fleet.parquet")
    (arguments.out / "fleet.html").write_text(page(table), encoding="utf-8")
    print(f"{len(table)} rows, {len(differing(table))} differ: {arguments.out / 'fleet.html'}")


if __name__ == "__main__":
    main()
