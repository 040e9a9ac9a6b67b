"""Many recordings: each is explained from the same effects, in processes of this machine or on a Dask cluster."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from . import _native
from ._files import PathLike, write_whole
from ._model import Model
from ._native import HysteronError
from ._records import load

Row = dict[str, Any]

_SCHEMA = "hysteron.survey/1"
#: Recordings of which the common effects are found.
_SAMPLE = 3


class Survey:
    """A row for each recording, those that stand out, units that differ."""

    def __init__(self, effects: list[str], rows: list[Row]) -> None:
        figures, self._page = _native.survey_of(effects, json.dumps(rows))
        #: Every figure, as the program's ``survey --json`` writes them.
        self.figures: dict[str, Any] = json.loads(figures)

    @property
    def rows(self) -> list[Row]:
        """A row for each recording, by name; ``error`` says why one has no verdict."""
        rows: list[Row] = self.figures["rows"]
        return rows

    @property
    def outliers(self) -> dict[str, list[str]]:
        """The recordings that stand out, and in what."""
        return {outlier["recording"]: outlier["in_what"] for outlier in self.figures["outliers"]}

    @property
    def units(self) -> list[dict[str, Any]]:
        """The values in which a unit (a folder, or a name before its last number) differs from all others."""
        units: list[dict[str, Any]] = self.figures["units"]
        return units

    def html(self) -> str:
        """The page: one file that opens without a network."""
        return self._page

    def save_report(self, path: PathLike) -> None:
        """Writes the page, whole or not at all."""
        write_whole(path, self._page)

    def __repr__(self) -> str:
        return f"Survey({len(self.rows)} recordings, {len(self.outliers)} stand out)"


def _row(name: str, path: str, effects: str, reading: dict[str, Any]) -> Row:
    """The row of one recording, in the process that works on it."""
    try:
        row: Row = json.loads(_native.survey_row(name, load(path, **reading)._native, effects))
    except HysteronError as error:
        row = {"recording": name, "error": str(error)}
    return row


def _alone() -> None:
    # The processes have the cores.
    os.environ["RAYON_NUM_THREADS"] = "1"


def _of_processes(tasks: list[tuple[Any, ...]], workers: int) -> Iterator[Row]:
    """Rows as they come. Of a pool that breaks the rest goes to another one; then one by one, which shows the recording that ends its process."""
    missing = {task[0]: task for task in tasks}
    breaks = 0
    while missing:
        alone = breaks > 1
        batch = list(missing.values())[: 1 if alone else None]
        try:
            with ProcessPoolExecutor(1 if alone else min(workers, len(batch)), get_context("spawn"), _alone) as pool:
                for future in as_completed([pool.submit(_row, *task) for task in batch]):
                    row = future.result()
                    del missing[row["recording"]]
                    yield row
        except BrokenProcessPool:
            breaks += 1
            if alone:
                name = next(iter(missing))
                del missing[name]
                yield {"recording": name, "error": f"{name}: the process that explained it ended; it may need more memory than there is"}


def _of_cluster(tasks: list[tuple[Any, ...]], client: Any) -> Iterator[Row]:
    """Rows as they come; a worker that is lost loses no recording."""
    distributed: Any = import_module("dask.distributed")
    names = {client.submit(_row, *task, pure=False): task[0] for task in tasks}
    for future in distributed.as_completed(list(names)):
        error = future.exception()
        yield future.result() if error is None else {"recording": names[future], "error": f"{names[future]}: {error}"}


def _recordings(folder: PathLike | Iterable[PathLike]) -> dict[str, str]:
    """Paths by what recordings are called: files, and folders with a manifest."""
    if not isinstance(folder, (str, os.PathLike)):
        return {Path(path).as_posix(): os.fspath(path) for path in folder}
    found, open_folders = {}, [Path(folder)]
    while open_folders:
        for path in open_folders.pop().iterdir():
            if path.name.startswith("."):
                continue
            if path.is_dir() and not (path / "dataset.toml").is_file():
                open_folders.append(path)
            else:
                found[path.relative_to(folder).as_posix()] = os.fspath(path)
    return dict(sorted(found.items()))


def _known(results: Path) -> tuple[list[str], list[Row]] | None:
    """Effects and rows of a file; a line that was cut off is left out, and done again."""
    if not results.exists():
        return None
    header, *lines = results.read_text(encoding="utf-8").splitlines() or [""]
    rows = []
    try:
        effects = json.loads(header)
    except ValueError:
        effects = {}
    if effects.get("schema") != _SCHEMA:
        raise HysteronError(f"{results}: expected the rows of a survey, whose first line has {_SCHEMA}")
    for line in lines:
        try:
            rows.append(json.loads(line))
        except ValueError:
            continue
    return effects["effects"], rows


def _common(paths: list[str], start: str, reading: dict[str, Any]) -> list[str]:
    """Effects that the recordings of a sample have in common."""
    sample: list[_native.Dataset] = []
    problem = None
    # As far apart as they can be; where none of them can be read, the first that can.
    apart = paths[:: max(len(paths) // _SAMPLE, 1)][:_SAMPLE]
    for number, path in enumerate([*apart, *paths]):
        if sample and number >= len(apart):
            break
        try:
            sample.append(load(path, **reading)._native)
        except HysteronError as error:
            problem = problem or error
    if not sample:
        raise problem or HysteronError("survey: there are no recordings; expected files, or folders with dataset.toml")
    return _native.common_effects(sample, start)


def survey(
    recordings: PathLike | Iterable[PathLike], client: Any = None, *, model: Model | None = None, start: str = "gain", workers: int | None = None,
    results: PathLike | None = None, progress: Callable[[str], Any] | None = None, **reading: Any,
) -> Survey:
    """Explains each recording of a folder, or of a list of paths, from the same effects: those of ``model``, or what a sample has in common.

    ``client`` is one of Dask; without it the work goes on in ``workers`` processes of this machine. ``results`` is a file that gets a row as soon
    as it is there: a survey that was interrupted goes on where it stopped. Further arguments are those of ``load``.
    """
    paths = _recordings(recordings)
    file = None if results is None else Path(results)
    known = None if file is None else _known(file)
    if known is None:
        effects = model.effects if model is not None else _common(list(paths.values()), start, reading)
        rows: list[Row] = []
    else:
        effects, rows = known
        if model is not None and model.effects != effects:
            raise HysteronError(f"{file}: has rows explained from {', '.join(effects)}; expected other results for another model")
    there = {row["recording"] for row in rows}
    if there - set(paths):
        raise HysteronError(f"{file}: has a row of {min(there - set(paths))}, which is not among the recordings; expected other results")
    tasks = [(name, path, ",".join(effects), reading) for name, path in paths.items() if name not in there]
    if file is not None:
        write_whole(file, "".join(json.dumps(line) + "\n" for line in [{"schema": _SCHEMA, "effects": effects}, *rows]))
    found = _of_processes(tasks, workers or os.cpu_count() or 1) if client is None else _of_cluster(tasks, client)
    for number, row in enumerate(found, 1):
        rows.append(row)
        if file is not None:
            with file.open("a", encoding="utf-8", newline="\n") as out:
                out.write(json.dumps(row) + "\n")
        if progress is not None:
            progress(f"{number} of {len(tasks)}: {row['recording']}")
    return Survey(effects, rows)
