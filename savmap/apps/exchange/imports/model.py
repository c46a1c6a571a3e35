"""Elements of a building model, IFC in STEP's text, any schema that the library `ifcopenshell` reads.

It is read in a process of its own (`model_reader`): the geometry kernel is ended by some broken files, and takes any
time for others.
"""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from savmap.apps.exchange.imports.records import FileElements, ImportOptions, ModelRequest, bytes_of
from savmap.errors import OutputError
from savmap.files.serialization import packed, unpacked
from savmap.maps.exports import require_library

MOST_MB = 256
"""Of a model: a whole hall; one of savmap with 46 rows has 5."""
MOST_S = 900.0
"""Of reading one."""
BEGIN, END = b"ISO-10303-21;", b"END-ISO-10303-21;"
MODEL, REQUEST, RESULT, FAULT = "model.ifc", "request", "result", "fault"
"""Files of the folder through which the reader's process is asked, and answers."""


def read_model(path: Path, options: ImportOptions, labels: Mapping[str, str]) -> FileElements:
    """The elements of a building model that have a label. `labels`: those of the plugins, by themselves and by classes
    of IFC in lower case. Raises OutputError."""
    content = bytes_of(path, MOST_MB)
    if BEGIN not in content[:1000]:
        raise OutputError(f"{path}: is no IFC model in STEP's text (compressed ones and XML are not read)")
    if END not in content:
        raise OutputError(f"{path}: is an IFC model that is cut off: its last line is missing")
    require_library("ifcopenshell", "bim")
    with TemporaryDirectory(prefix="savmap-model-") as name:
        folder = Path(name)
        (folder / MODEL).write_bytes(content)
        (folder / REQUEST).write_bytes(packed(ModelRequest(options, labels)))
        del content
        _run(path, folder)
        if not (folder / RESULT).exists():
            fault, ended = folder / FAULT, "is damaged: it ends the program that reads it"
            raise OutputError(f"{path}: {fault.read_text(encoding='utf-8') if fault.exists() else ended}")
        return unpacked((folder / RESULT).read_bytes(), FileElements)


def _run(path: Path, folder: Path) -> None:
    """Have another process read the model in a folder. Raises OutputError where it takes too long."""
    command = [sys.executable, "-P", "-m", "savmap.apps.exchange.imports.model_reader", str(folder)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    quiet = subprocess.DEVNULL
    try:
        subprocess.run(command, stdin=quiet, stdout=quiet, stderr=quiet, env=environment, timeout=MOST_S, check=False)
    except subprocess.TimeoutExpired:
        raise OutputError(f"{path}: takes more than {MOST_S:g} s to read: save what is to be read alone") from None
