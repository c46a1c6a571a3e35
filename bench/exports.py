"""Every format that savmap writes: seconds, size, and what validators say of the file.

    python -m bench exports MAP [--rows 46] [--format glb ...] [--skip-validators] [--keep DIR]

`--rows`: the map's first row that many times, side by side, 4 m apart, instead of the map. Validators that are not installed are named as such:
`pip install usd-validation-nvidia pyogrio`, and, in a folder that NODE_PATH names as its node_modules, `npm install gltf-validator web-ifc
@mapbox/geojsonhint` (of what the last one needs, one package lies in a git repository: where that cannot be reached, `"overrides":
{"@gerhobbelt/nomnom": "npm:nomnom@1.8.1"}` in package.json does without). NVIDIA_USD_VALIDATE: that command, if it is not on the PATH.
Ends with 1 if a validator finds more fault with a file than before.
"""

import argparse
import os
import shutil
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from bench.baseline import Figures
from savmap.errors import SavmapError
from savmap.maps.map_file import read_map
from savmap.plugin.manager import exporters
from savmap.types import Alignment, Placement, SiteMap

APART_M = 4.0
SOMEWHERE = Alignment(0.0, 0.0, 0.0, np.zeros((3, 3)), anchor=(48.137, 11.575))
"""Where a map is put that does not know where it is: some formats ask for latitude and longitude."""
GLTF = """
const validator = require("gltf-validator"), bytes = new Uint8Array(require("fs").readFileSync(process.argv[1]));
validator.validateBytes(bytes, {maxIssues: 20}).then((report) => {
    for (const message of report.issues.messages) console.log(`${message.code} ${message.message} ${message.pointer}`);
});
"""
WEB_IFC = """
const {IfcAPI} = require("web-ifc"), api = new IfcAPI();
api.Init().then(() => {
    const model = api.OpenModel(new Uint8Array(require("fs").readFileSync(process.argv[1])));
    let shapes = 0;
    api.StreamAllMeshes(model, () => { shapes += 1; });
    if (!shapes) console.log("no shape was read");
});
"""
GEOJSONHINT = """
const {hint} = require("@mapbox/geojsonhint"), text = require("fs").readFileSync(process.argv[1], "utf8");
for (const found of hint(text)) console.log(`${found.level || "error"} line ${found.line}: ${found.message}`);
"""
ENDINGS = {"ifc4x3": "ifc", "rosbag2": "mcap", "colmap": "zip", "nerfstudio": "json", "nav2": "zip"}
"""Of files of formats that are not called by theirs."""
Validator = Callable[[Path], list[str]]
"""What it finds wrong with a file, a line each. Raises `MissingError` where it is not installed."""


class MissingError(Exception):
    """A validator is not installed."""


def in_node(script: str, module: str, path: Path) -> list[str]:
    """What a script prints of a file."""
    node = shutil.which("node")
    if node is None:
        raise MissingError
    if subprocess.run([node, "-e", f"require.resolve('{module}')"], capture_output=True).returncode:
        raise MissingError
    return printed([node, "-e", script, str(path.resolve())])


def printed(command: Sequence[str]) -> list[str]:
    """The lines that a command prints; its error, too, where it fails."""
    done = subprocess.run(command, capture_output=True, text=True)
    return done.stdout.splitlines() + (done.stderr.splitlines()[-5:] or ["failed"] if done.returncode else [])


def usd_validation(path: Path) -> list[str]:
    """OpenUSD's own validators."""
    try:
        from pxr import Usd, UsdValidation
    except ImportError as error:
        raise MissingError from error
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    errors = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(str(path)))
    return [str(error.GetMessage()) for error in errors]


def nvidia_validation(path: Path) -> list[str]:
    """NVIDIA's validator of what Omniverse reads, by its command, which may lie in an environment of its own."""
    command = os.environ.get("NVIDIA_USD_VALIDATE") or shutil.which("nvidia_usd_validate")
    if command is None:
        raise MissingError
    done = subprocess.run([command, str(path)], capture_output=True, text=True)
    lines = (done.stdout + done.stderr).splitlines()
    return [] if any("No issues found" in line for line in lines) else lines[-20:]


def ifc_validation(path: Path) -> list[str]:
    """ifcopenshell's validator, with the schema's rules."""
    try:
        import ifcopenshell.validate as validate
    except ImportError as error:
        raise MissingError from error
    log = validate.json_logger()
    validate.validate(str(path), log, express_rules=True)
    return [str(statement) for statement in log.statements]


def dxf_audit(path: Path) -> list[str]:
    """ezdxf's audit of the file as it is read again."""
    try:
        import ezdxf
    except ImportError as error:
        raise MissingError from error
    auditor = ezdxf.readfile(path).audit()
    return [str(entry.message) for entry in (*auditor.errors, *auditor.fixes)]


def gdal(path: Path) -> list[str]:
    """Whether GDAL reads shapes."""
    try:
        import pyogrio
    except ImportError as error:
        raise MissingError from error
    return [] if pyogrio.read_info(path, force_feature_count=True)["features"] else ["no shape was read"]


VALIDATORS: Mapping[str, Mapping[str, Validator]] = {
    "glb": {"gltf-validator": partial(in_node, GLTF, "gltf-validator")},
    "usda": {"UsdValidation": usd_validation, "usd-validation-nvidia": nvidia_validation},
    "usdc": {"UsdValidation": usd_validation, "usd-validation-nvidia": nvidia_validation},
    "ifc": {"ifcopenshell.validate": ifc_validation, "web-ifc": partial(in_node, WEB_IFC, "web-ifc")},
    "ifc4x3": {"ifcopenshell.validate": ifc_validation, "web-ifc": partial(in_node, WEB_IFC, "web-ifc")},
    "dxf": {"ezdxf": dxf_audit, "GDAL": gdal},
    "geojson": {"geojsonhint": partial(in_node, GEOJSONHINT, "@mapbox/geojsonhint"), "GDAL": gdal},
}
"""By format, and by the validator's name."""


def measured(name: str, site: SiteMap, folder: Path, validate: bool) -> dict[str, float]:
    """Write a format into a folder and validate it: seconds, megabytes, and how many faults validators find; they are printed."""
    path = folder / f"map-{name}.{ENDINGS.get(name, name)}"
    begin = time.perf_counter()
    exporters()[name](site, path)
    figures: dict[str, float] = {"seconds": time.perf_counter() - begin, "MB": path.stat().st_size / 1e6, "faults": 0}
    for validator, check in VALIDATORS.get(name, {}).items() if validate else ():
        try:
            faults = check(path)
        except MissingError:
            print(f"{name}, {validator}: is not installed", flush=True)
            continue
        print(
            f"{name}, {validator}: {len(faults)} faults",
            *(fault[:300] for fault in faults[:10]),
            sep="\n    ",
            flush=True,
        )
        figures["faults"] += len(faults)
    return figures


def repeated(site: SiteMap, count: int) -> SiteMap:
    """A site of the map's first row, many times."""
    row = next(iter(site.rows.values()))
    names = [f"R{number}" for number in range(1, count + 1)]
    places = {name: Placement(0.0, APART_M * k, 180.0 * (k % 2), 1e-4 * np.eye(3)) for k, name in enumerate(names)}
    return SiteMap({name: replace(row, name=name) for name in names}, site.made_by, placements=places)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this bench."""
    parser.add_argument("map", type=Path)
    parser.add_argument("--rows", type=int, default=0)
    parser.add_argument("--format", nargs="+", choices=sorted(exporters()), default=[*exporters()])
    parser.add_argument("--skip-validators", action="store_true")


def run(given: argparse.Namespace) -> Figures:
    """Write and validate each format."""
    site = read_map(given.map)
    site = repeated(site, given.rows) if given.rows else site
    site = replace(site, alignment=site.alignment or SOMEWHERE)
    figures = {}
    folder = given.keep
    folder.mkdir(parents=True, exist_ok=True)
    for name in given.format:
        try:
            figures[name] = measured(name, site, folder, not given.skip_validators)
        except SavmapError as error:
            print(f"{name:16}cannot hold this map: {error}")
    return figures
