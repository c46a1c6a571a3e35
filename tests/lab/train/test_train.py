import importlib
import re
import resource
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from savmap.cli.app import app
from savmap.errors import OutputError, SavmapError
from savmap.lab.train import check_extra, train
from savmap.lab.train.plan import TrainedNetwork, TrainingPlan, warning_of

from .conftest import bars


def test_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.lab.train.NEEDED", ("numpy", "no_such_package"))
    with pytest.raises(SavmapError, match=r"no_such_package: install the extra with `pip install 'savmap\[train\]'`"):
        check_extra()


def test_importing_does_not_import_torch() -> None:
    import subprocess

    code = "import sys, savmap.lab.train; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


@pytest.mark.extra("train")
@pytest.mark.slow
class TestWithTorch:
    @pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
    def test_two_steps_give_a_model_that_the_segmenter_runs(self, four_pictures: Path, tmp_path: Path) -> None:
        import onnx

        from savmap.vision.networks.segmenter import Segmenter

        output = tmp_path / "m.onnx"
        lines: list[str] = []
        plan = TrainingPlan(["crossbar", "column"], [four_pictures], output, 1e-6, 1)
        network = train(plan, lambda _, line: lines.append(line))
        recipe = network.recipe
        segmenter = Segmenter(output)
        maps = segmenter.probabilities(np.zeros((480, 640, 3), np.uint8))
        assert segmenter.classes == ("crossbar", "column")
        assert maps.shape == (3, 480, 640)
        assert np.allclose(maps.sum(axis=0), 1, atol=1e-5)
        assert recipe["steps"] == 2
        assert "validation" in recipe
        assert network.files == (output,)
        assert network.warning is not None
        assert re.search(r"m\.onnx is useless so far: IoU 0\.\d{3} .* after 2 steps .*--minutes 60", network.warning)
        card = {entry.key: entry.value for entry in onnx.load(output).metadata_props}
        assert card["savmap.warning"] == network.warning
        assert any("step 2" in line for line in lines)
        assert output.stat().st_size < 10e6
        beside = output.with_suffix(".checkpoint.pt")
        assert not output.with_suffix(".resume.pt").exists()
        again = train(TrainingPlan(["column"], [four_pictures], tmp_path / "n.onnx", 1e-6, 1, beside)).recipe
        assert Segmenter(tmp_path / "n.onnx").classes == ("column",)
        assert len(again["earlier"]) == 1

    def test_any_size_that_32_divides(self) -> None:
        import torch

        from savmap.lab.train.network import build

        network = build(2, None).eval()
        with torch.inference_mode():
            assert network(torch.zeros(1, 3, 64, 96)).shape == (1, 3, 64, 96)

    def test_where_torch_computes_gives_the_processor_s_network(self) -> None:
        import torch

        from savmap.lab.train.device import compute_device, device_of, threads_beside
        from savmap.lab.train.network import build
        from savmap.lab.train.trainer import FINE_TUNING, Trainer, predictor

        image, mask = bars(np.random.default_rng(0))
        trainer = Trainer(build(2, None), FINE_TUNING)
        assert device_of(trainer.network) == device_of(trainer.average.network)
        assert trainer.device.type == compute_device().type == ("cuda" if torch.cuda.is_available() else "cpu")
        assert threads_beside(torch.device("cpu")) == 1 <= threads_beside(torch.device("cuda"))
        assert np.isfinite(trainer.step((image[None, :288, :384], mask[None, :288, :384]), 0.5))
        there = predictor(trainer.average.network)(image)
        here = predictor(trainer.average.network.cpu())(image)
        assert np.allclose(there, here, atol=0.02)

    def test_loss_does_not_prefer_wide_or_narrow_masks(self) -> None:
        import torch

        from savmap.lab.train.trainer import edge_weights

        labels = torch.zeros(1, 20, 30, dtype=torch.int64)
        labels[:, :, 15:] = 1
        weights = edge_weights(labels)
        assert torch.equal(weights, weights.flip(2))
        assert weights.max() > weights.min()

    def test_where_labels_end_is_no_edge(self) -> None:
        import torch

        from savmap.lab.train.trainer import edge_weights

        labels = torch.full((1, 20, 30), 255, dtype=torch.int64)
        labels[:, :, :10] = 1
        assert torch.all(edge_weights(labels) == 1)

    @pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
    def test_the_mean_of_two_checkpoints(self, tmp_path: Path) -> None:
        import torch

        from savmap.lab.train.average import average
        from savmap.lab.train.checkpoint import load_checkpoint, save_checkpoint
        from savmap.lab.train.network import build
        from savmap.vision.networks.segmenter import Segmenter

        one, other = build(1, None), build(1, None)
        for name, network in (("a", one), ("b", other)):
            save_checkpoint(tmp_path / f"{name}.pt", network, ["column"], [{"steps": name}])
        recipe = average([tmp_path / "a.pt", tmp_path / "b.pt"], ["column"], tmp_path / "m.onnx")
        assert recipe["earlier"] == [{"steps": "b"}]
        mean, _ = load_checkpoint(tmp_path / "m.checkpoint.pt", ["column"])
        for left, right, both in zip(one.parameters(), other.parameters(), mean.parameters(), strict=True):
            assert torch.allclose((left + right) / 2, both)
        assert Segmenter(tmp_path / "m.onnx").classes == ("column",)
        recipe = average([tmp_path / "a.pt", tmp_path / "b.pt"], ["column"], tmp_path / "m.onnx", weights=[1, 3])
        assert recipe["weights"] == [1, 3]
        mean, _ = load_checkpoint(tmp_path / "m.checkpoint.pt", ["column"])
        for left, right, both in zip(one.parameters(), other.parameters(), mean.parameters(), strict=True):
            assert torch.allclose(0.25 * left + 0.75 * right, both, atol=1e-6)
        with pytest.raises(OutputError, match=r"--weights: give one above 0 for each of the 2 files"):
            average([tmp_path / "a.pt", tmp_path / "b.pt"], ["column"], tmp_path / "n.onnx", weights=[1])
        with pytest.raises(OutputError, match=r"a\.pt: is for column, not for crossbar"):
            average([tmp_path / "a.pt", tmp_path / "b.pt"], ["crossbar"], tmp_path / "n.onnx")
        assert not (tmp_path / "n.onnx").exists()

    def test_the_mean_of_files(self, tmp_path: Path) -> None:
        import torch

        from savmap.lab.train.average import average
        from savmap.lab.train.export import export
        from savmap.lab.train.network import build
        from savmap.vision.networks.segmenter import Segmenter

        network = build(1, None)
        for layer in network.modules():
            if isinstance(layer, torch.nn.BatchNorm2d):
                torch.nn.init.normal_(layer.bias, std=0.1)
        export(network, ["column"], {}, tmp_path / "one.onnx")
        average([tmp_path / "one.onnx", tmp_path / "one.onnx"], ["column"], tmp_path / "mean.onnx")
        picture = np.random.default_rng(0).integers(0, 255, (480, 640, 3)).astype(np.uint8)
        once, twice = (Segmenter(tmp_path / f"{name}.onnx").probabilities(picture) for name in ("one", "mean"))
        assert np.allclose(once, twice, atol=1e-3)

    def test_a_raised_class_is_seen_more(self, tmp_path: Path) -> None:
        from savmap.lab.train.average import average
        from savmap.lab.train.checkpoint import save_checkpoint
        from savmap.lab.train.network import build
        from savmap.vision.networks.segmenter import Segmenter

        classes = ["column", "crossbar"]
        save_checkpoint(tmp_path / "a.pt", build(2, None), classes, [])
        average([tmp_path / "a.pt"], classes, tmp_path / "as-it-is.onnx")
        recipe = average([tmp_path / "a.pt"], classes, tmp_path / "raised.onnx", {"crossbar": 0.7})
        assert recipe["logits raised by"] == {"crossbar": 0.7}
        picture = np.random.default_rng(0).integers(0, 255, (480, 640, 3)).astype(np.uint8)
        before, after = (
            np.log(Segmenter(tmp_path / f"{name}.onnx").probabilities(picture)) for name in ("as-it-is", "raised")
        )
        assert np.allclose((after[2] - after[0]) - (before[2] - before[0]), 0.7, atol=1e-3)
        assert np.allclose(after[1] - after[0], before[1] - before[0], atol=1e-3)
        with pytest.raises(OutputError, match=r"--raise purlin: is no class of column, crossbar"):
            average([tmp_path / "a.pt"], classes, tmp_path / "n.onnx", {"purlin": 0.1})

    def test_a_full_disk_keeps_the_earlier_checkpoint(self, tmp_path: Path) -> None:
        from savmap.lab.train.checkpoint import save_checkpoint
        from savmap.lab.train.network import build

        path, network = tmp_path / "c.pt", build(1, None)
        save_checkpoint(path, network, ["column"], [])
        before = path.read_bytes()
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
        try:
            with pytest.raises(OutputError, match=r"c\.pt: cannot be written"):
                save_checkpoint(path, network, ["column"], [{"steps": 1}])
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert path.read_bytes() == before
        assert [one.name for one in tmp_path.iterdir()] == ["c.pt"]

    def test_not_a_checkpoint(self, tmp_path: Path) -> None:
        import torch

        from savmap.lab.train.checkpoint import load_checkpoint
        from savmap.lab.train.network import build

        path = tmp_path / "c.pt"
        weights = build(1, None).state_dict()
        for content in (torch.zeros(3), [1], {"network": weights, "classes": ["column"], "history": "{"}):
            torch.save(content, path)
            with pytest.raises(OutputError, match="not a checkpoint"):
                load_checkpoint(path, ["column"])
        path.write_bytes(b"nothing")
        with pytest.raises(OutputError, match="not a checkpoint"):
            load_checkpoint(path, ["column"])

    @pytest.mark.parametrize(
        ("module", "arguments", "code"),
        [
            ("average", ["none.pt", "--classes", "column", "-o", "m.onnx"], 9),
            ("quantise", ["none.onnx", "--data", "none", "-o", "m.onnx"], 6),
        ],
    )
    def test_modules_end_in_one_line(
        self,
        module: str,
        arguments: list[str],
        code: int,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [module, *arguments])
        with pytest.raises(SystemExit) as end:
            importlib.import_module(f"savmap.lab.train.{module}").main()
        assert end.value.code == code
        assert capsys.readouterr().err.count("\n") == 1
        assert not list(tmp_path.iterdir())


def test_a_network_that_sees_enough_has_no_warning(tmp_path: Path) -> None:
    plan = TrainingPlan(["column"], [tmp_path], tmp_path / "m.onnx", 1)
    assert warning_of(plan, 0.8, 900) == {}
    assert set(warning_of(plan, 0.1, 17)) == {"warning"}


def test_the_command_warns_of_a_useless_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def useless(plan: TrainingPlan, progress: object) -> TrainedNetwork:
        return TrainedNetwork(plan, (plan.output,), warning_of(plan, 0.001, 17))

    monkeypatch.setattr("savmap.lab.commands.check", lambda plan: None)
    monkeypatch.setattr("savmap.lab.train.train", useless)
    output = tmp_path / "poor.onnx"
    ended = CliRunner().invoke(app, ["train", "shelves", "--data", str(tmp_path), "-o", str(output)])
    assert ended.exit_code == 0
    assert f"wrote {output}" in ended.stdout
    assert "WARNING: poor.onnx is useless so far: IoU 0.001" in ended.stderr


def test_output_must_be_onnx(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.lab.train.NEEDED", ())
    with pytest.raises(OutputError, match=r"must end in \.onnx"):
        train(TrainingPlan(["column"], [tmp_path], tmp_path / "m.bin", 1))
