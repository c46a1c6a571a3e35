"""Every format that savmap writes: seconds, size, and what validators say of the file.

    python bench/exports.py MAP [--rows 46] [--format glb ...] [--skip-validators] [-o bench/results/exports]

`--rows`: the map's first row that many times, side by side, 4 m apart, instead of the map. Validators that are not installed are named as such:
`pip install usd-validation-nvidia pyogrio`, and, in a folder that NODE_PATH names as its node_modules, `npm install gltf-validator web-ifc
@mapbox/geojsonhint` (of what the last one needs, one package lies in a git repository: where that cannot be reached, `"overrides":
{"@gerhobbelt/nomnom": "npm:nomnom@1.8.1"}` in package.json does without). NVIDIA_USD_VALIDATE: that command, if it is not on the PATH.
Printed: a line for each format and, indented, one for each validator. Written: the files, and figures.json. Ends with 1 if a validator finds
fault with a file.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from savmap.errors import SavmapError
from savmap.files.atomic import write_text
from savmap.maps.exports import FORMATS, core_exporters
from savmap.maps.map_file import read_map
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
ENDINGS = {"ifc4x3": "ifc", "rosbag2": "mcap", "colmap": "zip", "nerfstudio": "json", "nav2": "zip", "imdf": "zip"}
"""Of files of formats that are not called by theirs."""
Validator = Callable[[Path], list[str]]
"""What it finds wrong with a file, a line each. Raises `MissingError` where it is not installed."""


class MissingError(Exception):
    """A validator is not installed."""


@dataclass(frozen=True)
class Result:
    """A format: seconds, bytes, and each validator's faults (None: it is not installed), with the seconds that it took."""

    name: str
    seconds: float
    size: int
    faults: Mapping[str, Sequence[str] | None]
    took: Mapping[str, float]


def gltf_validator(path: Path) -> list[str]:
    """Khronos' own."""
    return in_node(GLTF, "gltf-validator", path)


def web_ifc(path: Path) -> list[str]:
    """Whether web-ifc, which viewers in browsers use, reads shapes."""
    return in_node(WEB_IFC, "web-ifc", path)


def geojsonhint(path: Path) -> list[str]:
    """Mapbox's linter of GeoJSON (RFC 7946)."""
    return in_node(GEOJSONHINT, "@mapbox/geojsonhint", path)


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
    "glb": {"gltf-validator": gltf_validator},
    "usda": {"UsdValidation": usd_validation, "usd-validation-nvidia": nvidia_validation},
    "usdc": {"UsdValidation": usd_validation, "usd-validation-nvidia": nvidia_validation},
    "ifc": {"ifcopenshell.validate": ifc_validation, "web-ifc": web_ifc},
    "ifc4x3": {"ifcopenshell.validate": ifc_validation, "web-ifc": web_ifc},
    "dxf": {"ezdxf": dxf_audit, "GDAL": gdal},
    "geojson": {"geojsonhint": geojsonhint, "GDAL": gdal},
}
"""By format, and by the validator's name."""


def measured(name: str, site: SiteMap, folder: Path, validate: bool) -> Result:
    """A format, written into a folder and validated."""
    path = folder / f"map-{name}.{ENDINGS.get(name, name)}"
    begin = time.perf_counter()
    core_exporters()[name](site, path)
    seconds = time.perf_counter() - begin
    faults, took = dict[str, Sequence[str] | None](), dict[str, float]()
    for validator, check in VALIDATORS.get(name, {}).items() if validate else ():
        begin = time.perf_counter()
        try:
            faults[validator] = check(path)
        except MissingError:
            faults[validator] = None
        took[validator] = time.perf_counter() - begin
    return Result(name, seconds, path.stat().st_size, faults, took)


def lines_of(result: Result) -> list[str]:
    """What is printed of a format."""
    lines = [f"{result.name:16}{result.seconds:8.2f} s{result.size / 1e6:10.3f} MB"]
    for validator, faults in result.faults.items():
        said = "is not installed" if faults is None else f"{len(faults)} faults" if faults else "no fault"
        lines.append(f"    {validator}: {said}, {result.took[validator]:.1f} s")
        lines += [f"        {fault[:300]}" for fault in (faults or [])[:10]]
    return lines


def repeated(site: SiteMap, count: int) -> SiteMap:
    """A site of the map's first row, many times."""
    row = next(iter(site.rows.values()))
    names = [f"R{number}" for number in range(1, count + 1)]
    places = {name: Placement(0.0, APART_M * k, 180.0 * (k % 2), 1e-4 * np.eye(3)) for k, name in enumerate(names)}
    return SiteMap({name: replace(row, name=name) for name in names}, site.made_by, placements=places)


def main(arguments: Sequence[str] | None = None) -> int:
    """Write and validate; 1 if there is a fault."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("map", type=Path)
    parser.add_argument("--rows", type=int, default=0)
    parser.add_argument("--format", nargs="+", choices=sorted(FORMATS), default=list(FORMATS))
    parser.add_argument("--skip-validators", action="store_true")
    parser.add_argument("-o", "--output", type=Path, default=Path("bench/results/exports"))
    given = parser.parse_args(arguments)
    site = read_map(given.map)
    site = repeated(site, given.rows) if given.rows else site
    site = replace(site, alignment=site.alignment or SOMEWHERE)
    given.output.mkdir(parents=True, exist_ok=True)
    results = []
    for name in given.format:
        try:
            results.append(measured(name, site, given.output, not given.skip_validators))
            print("\n".join(lines_of(results[-1])), flush=True)
        except SavmapError as error:
            print(f"{name:16}cannot hold this map: {error}")
    print(f"{'all':16}{sum(result.seconds for result in results):8.2f} s")
    figures = {result.name: {"seconds": round(result.seconds, 3), "bytes": result.size} for result in results}
    write_text(given.output / "figures.json", json.dumps(figures, indent=1) + "\n")
    return int(any(faults for result in results for faults in result.faults.values()))


if __name__ == "__main__":
    sys.exit(main())
