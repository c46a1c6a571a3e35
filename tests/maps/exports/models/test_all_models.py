"""What holds for every format of models: the same map gives the same bytes, and a missing library is named with its extra."""

import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

import savmap
from savmap.errors import OutputError
from savmap.maps.map_file import read_map, write_map

from .made_up_models import made_up_site

LIBRARIES = {
    "usdc": ("pxr.Sdf", "usd"),
    "ifc": ("ifcopenshell", "bim"),
    "ifc4x3": ("ifcopenshell", "bim"),
    "dxf": ("ezdxf", "cad"),
}
NAMES = ("glb", "usda", *LIBRARIES)
EACH = [
    pytest.param(name, marks=[pytest.mark.extra(LIBRARIES[name][1])] if name in LIBRARIES else []) for name in NAMES
]
AGAIN = """
import sys
from pathlib import Path
from savmap.maps.exports import core_exporters
from savmap.maps.map_file import read_map

for name in sys.argv[2:]:
    core_exporters()[name](read_map(Path(sys.argv[1])), Path(sys.argv[1]).parent / name)
"""


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a map, and with its exports as another process writes them, whose sets have another order."""
    map_file = tmp_path_factory.mktemp("written") / "map.json"
    write_map(made_up_site(), map_file)
    here = [name for name in NAMES if name not in LIBRARIES or find_spec(LIBRARIES[name][0].partition(".")[0])]
    command = [sys.executable, "-c", AGAIN, str(map_file), *here]
    subprocess.run(command, check=True, timeout=120, env={**os.environ, "PYTHONHASHSEED": "7"})
    return map_file.parent


@pytest.mark.parametrize("name", EACH)
def test_the_same_map_gives_the_same_bytes(name: str, written: Path, tmp_path: Path) -> None:
    first = savmap.export(read_map(written / "map.json"), tmp_path / "first", name)
    assert first.read_bytes() == (written / name).read_bytes()


@pytest.mark.parametrize("name", LIBRARIES)
def test_a_missing_library_is_named(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    module, extra = LIBRARIES[name]
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(OutputError, match=rf"needs {module}: pip install 'savmap\[{extra}\]'"):
        savmap.export(made_up_site(), tmp_path / "map", name)
    assert not list(tmp_path.iterdir())
