"""The command line: read arguments, call the library, print. Everything heavy is imported when it is needed."""

import os
import sys
from pathlib import Path
from typing import Annotated

import typer

from savmap.commands import plugin
from savmap.commands.endings import plain_endings
from savmap.io.where import where

app = typer.Typer(
    name="savmap",
    help="Metric, semantic wireframe maps of structured places from panoramic video.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
app.add_typer(plugin.app, name="plugin")
Plugins = Annotated[str | None, typer.Option(help="Comma-separated plugins; default: those that the site file names.")]
Sets = Annotated[
    list[str] | None, typer.Option("--set", help="KEY=VALUE: a key of the site file, such as rows.A.fps=5.")
]
Output = Annotated[
    Path, typer.Option("-o", "--output", parser=where, metavar="FOLDER", help="Folder for the results, or a URL.")
]


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"savmap {version('savmap')}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Metric, semantic wireframe maps of structured places from panoramic video."""


@app.command("map")
def map_(
    source: Annotated[
        Path, typer.Argument(metavar="SOURCE", parser=where, help="A site file, or a panoramic video for a first map.")
    ] = Path("site.yaml"),
    plugins: Plugins = None,
    output: Output = Path("out"),
    camera_height: Annotated[float | None, typer.Option(help="Camera height above the floor, m (for a video).")] = None,
    side: Annotated[str | None, typer.Option(help="left or right: the hand the face is on (for a video).")] = None,
    trajectory: Annotated[Path | None, typer.Option(help="A map whose camera path is taken as known.")] = None,
    preview: Annotated[bool, typer.Option(help="Only write pictures of the chosen views.")] = False,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=0, help="Rows mapped at a time, each in a process of its own (0: in this one; default: as fits)."
        ),
    ] = None,
    cluster: Annotated[
        str | None, typer.Option(help="A Dask scheduler whose workers map the rows, such as tcp://host:8786.")
    ] = None,
    fresh: Annotated[
        bool, typer.Option(help="Do everything again, whatever an earlier run left in the folder.")
    ] = False,
    sets: Sets = None,
) -> None:
    """Map a site (default: site.yaml of this folder) or one video. What an earlier run left in the folder, if it still holds, is
    not done again."""
    from savmap import run
    from savmap.io.overrides import overrides_of
    from savmap.job import job_for
    from savmap.mapping import Way

    overrides = overrides_of(sets or [], os.environ)
    job = job_for(source, _names(plugins), output, camera_height, side, trajectory, overrides)
    for line in run.preview(job) if preview else run.run(job, Way(jobs, fresh, cluster)):
        typer.echo(line)


@app.command()
def init(
    videos: Annotated[list[Path] | None, typer.Argument(metavar="[VIDEO]...", help="A row is made for each.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The site file to write.")] = Path("site.yaml"),
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that is there.")] = False,
) -> None:
    """Write a commented site file to start from."""
    from savmap import starter

    for line in starter.start(videos or [], output, force):
        typer.echo(line)


@app.command()
def check(
    source: Annotated[Path, typer.Argument(metavar="SITE", help="A site file.")] = Path("site.yaml"),
    plugins: Plugins = None,
    output: Output = Path("out"),
    trajectory: Annotated[Path | None, typer.Option(help="A map whose camera path is taken as known.")] = None,
    pictures: Annotated[bool, typer.Option(help="Write a picture of the chosen views of each pass.")] = True,
    sets: Sets = None,
) -> None:
    """Say what is wrong with a site file, and what a run will take."""
    from savmap import check as checking
    from savmap.io.overrides import overrides_of

    overrides = overrides_of(sets or [], os.environ)
    for line in checking.check(source, _names(plugins), output, overrides, pictures, trajectory):
        typer.echo(line)


@app.command()
def demo(output: Output = Path("out/demo")) -> None:
    """Map the footage that ships with savmap and score it."""
    from savmap import run

    for line in run.demo(output):
        typer.echo(line)


@app.command()
def evaluate(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A map.json.")],
    survey: Annotated[Path, typer.Argument(metavar="SURVEY", help="A survey file.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    box_plot: Annotated[Path | None, typer.Option(help="Write a box plot of the errors by class (PNG).")] = None,
) -> None:
    """Score a map against a survey."""
    from savmap import run

    evaluation = run.evaluate_files(map_file, survey, box_plot)
    typer.echo(run.scores_json(evaluation) if as_json else run.scores_table(evaluation))


@app.command()
def report(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A map.json.")],
    run_file: Annotated[
        Path | None, typer.Option("--run", metavar="FILE", help="The run.json of the same run.")
    ] = None,
    survey: Annotated[Path | None, typer.Option(help="A survey file to show errors against.")] = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="The HTML page to write.")] = Path("report.html"),
) -> None:
    """Write a map's report: one HTML page with plan, states, references, errors and times."""
    from savmap.sitereport import report_files

    typer.echo(report_files(map_file, output, run_file, survey))


@app.command()
def export(
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A map.json.")],
    name: Annotated[str, typer.Option("--format", help="csv, ply, or a format of an installed plugin.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The file to write.")],
    row: Annotated[str | None, typer.Option(help="Only this row.")] = None,
) -> None:
    """Write a map in another format."""
    from savmap import tools

    for line in tools.export(map_file, name, output, row):
        typer.echo(line)


@app.command()
def find(
    name: Annotated[str, typer.Argument(metavar="NAME", help="What is written on it, such as A21-03, or its id.")],
    map_file: Annotated[Path, typer.Argument(metavar="MAP", help="A map.json.")] = Path("out/map.json"),
) -> None:
    """Say where in a map a thing is."""
    from savmap import tools

    for line in tools.find(map_file, name):
        typer.echo(line)


@app.command("plugins")
def plugins_() -> None:
    """List the installed plugins."""
    from savmap import tools

    for line in tools.plugin_lines():
        typer.echo(line)


@app.command()
def split(
    recording: Annotated[Path, typer.Argument(metavar="RECORDING", help="A long panoramic video.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The site file to write.")] = Path("site.yaml"),
    into: Annotated[Path | None, typer.Option(help="Add the rows to this site file instead.")] = None,
    sheet: Annotated[Path | None, typer.Option(help="Write a contact sheet of the passes (PNG).")] = None,
) -> None:
    """Find the passes through aisles in a long recording, and write them into a site file to be confirmed."""
    from savmap import tools

    for line in tools.split(recording, output, into, sheet):
        typer.echo(line)


@app.command()
def schema(name: Annotated[str, typer.Argument(metavar="site|map", help="Which kind of file.")]) -> None:
    """Print the JSON Schema of site files or maps."""
    from savmap import tools

    typer.echo(tools.schema(name), nl=False)


@app.command()
def simulate(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="A scene file.")],
    output: Output = Path("simulated"),
    mask: Annotated[list[str] | None, typer.Option(help="YAW,PITCH,HFOV: also write class masks of this view.")] = None,
) -> None:
    """Make footage of a made-up place, with its truth."""
    from savmap import tools

    for line in tools.simulate(scene, output, mask or []):
        typer.echo(line)


@app.command()
def train(
    plugin: Annotated[str, typer.Argument(metavar="PLUGIN", help="The plugin whose network is to be trained.")],
    data: Annotated[list[Path], typer.Option(help="Labelled pictures: a folder, or its file; may be repeated.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The ONNX file to write.")] = Path("model.onnx"),
    minutes: Annotated[
        float | None, typer.Option(min=0, help="How long to train (60; fine-tuning: 20).", show_default=False)
    ] = None,
    steps: Annotated[int | None, typer.Option(min=1, help="How many steps, instead of how long.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    init: Annotated[
        Path | None, typer.Option(help="What to begin with: a checkpoint; or `shipped` or an ONNX file, to fine-tune.")
    ] = None,
    renamed: Annotated[
        list[str] | None,
        typer.Option("--class", metavar="THEIRS=OURS", help="What a class of the data is called here."),
    ] = None,
    held_out: Annotated[list[Path] | None, typer.Option(help="Fine-tuning: a data set only to measure on.")] = None,
    int8: Annotated[bool, typer.Option("--int8", help="Fine-tuning: also write it in 8-bit integers.")] = False,
) -> None:
    """Train or fine-tune a plugin's network (needs the `train` extra). The same command goes on with a run that was stopped."""
    from savmap import training

    wish = training.Wish(data, output, minutes, seed, init, renamed or (), held_out or (), int8, steps)
    for line in training.train(plugin, wish):
        typer.echo(line)


@app.command()
def label(
    source: Annotated[Path, typer.Argument(metavar="SOURCE", parser=where, help="A site file, or a panoramic video.")],
    plugin: Annotated[
        str | None, typer.Option(help="Whose views and classes; default: the site's first plugin.")
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="How many pictures.")] = 100,
    output: Output = Path("labels"),
    sets: Sets = None,
) -> None:
    """Choose the views most worth labelling, and write them with the network's own masks to start from."""
    from savmap.io.overrides import overrides_of
    from savmap.label.run import label as choose_and_write

    for line in choose_and_write(source, plugin, count, output, overrides_of(sets or [], os.environ)):
        typer.echo(line)


def _names(text: str | None) -> list[str] | None:
    return [name.strip() for name in text.split(",") if name.strip()] if text is not None else None


def _plugin_commands() -> None:
    """Let installed third-party plugins add commands, when the first argument is none of ours."""
    ours = {group.name for group in app.registered_groups} | {
        command.name or (command.callback.__name__ if command.callback else "") for command in app.registered_commands
    }
    wanted = next((word for word in sys.argv[1:] if not word.startswith("-")), None)
    if wanted is not None and wanted not in ours:
        from savmap.rooms import register_commands

        register_commands(app)


def main() -> None:
    """Run the command line. Expected errors end it with one line and their exit code (docs/exit-codes.md)."""
    with plain_endings():
        _plugin_commands()
        app()
