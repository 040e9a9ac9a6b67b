"""The notebook of the examples runs, and prints what is stored in it. HYSTERON_WRITE_NOTEBOOK=1 stores what it prints now."""

import os
import pathlib
import unittest

import nbformat
from nbclient import NotebookClient

NOTEBOOK = pathlib.Path(__file__).resolve().parents[3] / "examples" / "recording_to_servo.ipynb"
SECONDS_OF_A_CELL = 600


def printed(notebook):
    """What each cell prints."""
    cells = [cell for cell in notebook.cells if cell.cell_type == "code"]
    return ["".join(output.get("text", "") for output in cell.outputs) for cell in cells]


class Notebook(unittest.TestCase):
    def test_the_notebook_prints_what_is_stored_in_it(self):
        stored = nbformat.read(NOTEBOOK, as_version=4)
        notebook = nbformat.from_dict(stored)
        place = {"metadata": {"path": str(NOTEBOOK.parent)}}
        client = NotebookClient(notebook, timeout=SECONDS_OF_A_CELL, kernel_name="python3", record_timing=False, resources=place)
        before = printed(stored)
        client.execute()
        self.assertIn("Creep is missing", printed(notebook)[1])
        if os.environ.get("HYSTERON_WRITE_NOTEBOOK"):
            # Versions of the machine that ran it are no part of the example.
            notebook.metadata.language_info = {"name": "python"}
            nbformat.write(notebook, NOTEBOOK)
            return
        self.assertEqual(printed(notebook), before, "run `cargo xtask notebook` to store what it prints now")


if __name__ == "__main__":
    unittest.main()
