import importlib
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from savmap.cli.app import app
from savmap.errors import OutputError, SavmapError
from savmap.lab.train import check_extra, train
from savmap.lab.train.plan import TrainedNetwork, TrainingPlan, warning_of

from .conftest import MODELS, bars


def test_missing_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("savmap.lab.train.NEEDED", ("numpy", "no_such_package"))
    with pytest.raises(SavmapError, match=r"no_such_package: install the extra with `pip install 'savmap\[train\]'`"):
        check_extra()


@pytest.fixture
def exported(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The networks that `average` would have written as ONNX files, which takes a quarter of a minute each."""
    networks: list[Any] = []
    monkeypatch.setattr("savmap.lab.train.average.export", lambda network, *others: networks.append(network))
    return networks


@pytest.mark.extra("train")
@pytest.mark.slow
class TestWithTorch:
    @pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning")
    def test_two_steps_give_a_model_that_the_segmenter_runs(self, four_pictures: Path, tmp_path: Path) -> None:
        import onnx

        from savmap.lab.train.checkpoint import load_checkpoint
        from savmap.vision.networks.segmenter import Segmenter

        output = tmp_path / "m.onnx"
        lines: list[str] = []
        plan = TrainingPlan(["crossbar", "column"], [four_pictures], output, 1e-6, 1)
        trained = train(plan, lambda _, line: lines.append(line))
        recipe = trained.recipe
        segmenter = Segmenter(output)
        maps = segmenter.probabilities(np.zeros((480, 640, 3), np.uint8))
        assert segmenter.classes == ("crossbar", "column")
        assert maps.shape == (3, 480, 640)
        assert np.allclose(maps.sum(axis=0), 1, atol=1e-5)
        assert recipe["steps"] == 2
        assert "validation" in recipe
        assert trained.files == (output,)
        assert trained.warning is not None
        assert re.search(r"m\.onnx is useless so far: IoU 0\.\d{3} .* after 2 steps .*--minutes 60", trained.warning)
        card = {entry.key: entry.value for entry in onnx.load(output).metadata_props}
        assert card["savmap.warning"] == trained.warning
        assert any("step 2" in line for line in lines)
        assert output.stat().st_size < 10e6
        assert not output.with_suffix(".resume.pt").exists()
        network, history = load_checkpoint(output.with_suffix(".checkpoint.pt"), ["column"])
        assert network.finish.logits.out_channels == 4 * 2
        assert len(history) == 1

    def test_any_size_that_32_divides(self) -> None:
        import torch

        from savmap.lab.train.network import build

        network = build(2, None).eval()
        with torch.inference_mode():
            assert network(torch.zeros(1, 3, 64, 96)).shape == (1, 3, 64, 96)

    def test_where_torch_computes_gives_the_processor_s_network(self) -> None:
        import torch

        from savmap.lab.train.network import build
        from savmap.lab.train.trainer import (
            FINE_TUNING,
            Trainer,
            compute_device,
            device_of,
            predictor,
            threads_beside,
        )

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

    def test_the_mean_of_checkpoints(self, tmp_path: Path, exported: list[Any]) -> None:
        import torch

        from savmap.lab.train.average import average
        from savmap.lab.train.checkpoint import load_checkpoint, save_checkpoint
        from savmap.lab.train.network import build

        networks = [build(1, None), build(1, None)]
        files = [tmp_path / "a.pt", tmp_path / "b.pt"]
        for path, network in zip(files, networks, strict=True):
            save_checkpoint(path, network, ["column"], [{"steps": path.stem}])
        for weights, share in (([], 0.5), ([1.0, 3.0], 0.75)):
            recipe = average(files, ["column"], tmp_path / "m.onnx", weights=weights)
            assert recipe["earlier"] == [{"steps": "b"}]
            assert recipe.get("weights", []) == weights
            mean = load_checkpoint(tmp_path / "m.checkpoint.pt", ["column"])[0].parameters()
            for first, second, both in zip(*(one.parameters() for one in networks), mean, strict=True):
                assert torch.allclose(first + share * (second - first), both, atol=1e-6)
        assert len(exported) == 2
        with pytest.raises(OutputError, match=r"--weights: give one above 0 for each of the 2 files"):
            average(files, ["column"], tmp_path / "n.onnx", weights=[1])
        with pytest.raises(OutputError, match=r"a\.pt: is for column, not for crossbar"):
            average(files, ["crossbar"], tmp_path / "n.onnx")
        assert not (tmp_path / "n.onnx").exists()

    def test_the_mean_of_files(self, tmp_path: Path, exported: list[Any]) -> None:
        from savmap.lab.train.average import average
        from savmap.lab.train.trainer import predictor
        from savmap.vision.networks.segmenter import Segmenter

        average([MODELS["lights"]] * 2, ["light"], tmp_path / "mean.onnx")
        picture = np.random.default_rng(0).integers(0, 255, (480, 640, 3)).astype(np.uint8)
        once, twice = Segmenter(MODELS["lights"]).probabilities(picture), predictor(exported[0])(picture)
        assert np.allclose(once, twice, atol=1e-3)

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
